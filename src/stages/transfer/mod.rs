pub mod bounce;
pub mod map;
pub mod shadow;
pub mod sight;
