pub mod bounce;
pub mod map;
