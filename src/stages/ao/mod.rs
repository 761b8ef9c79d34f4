//! Volume ambient occlusion. VAO §5.1, §6.

pub mod compose;
pub mod glass;
pub mod march;
pub mod query;
