pub mod depth;
pub mod mask;
