pub mod gbuffer;
