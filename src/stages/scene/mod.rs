pub mod deform;
pub mod gbuffer;
