pub mod compose;
pub mod depth;
pub mod mask;
