//! Horizon-split ambient occlusion, the screen-space method that VAO §6 compares with.

pub mod march;
