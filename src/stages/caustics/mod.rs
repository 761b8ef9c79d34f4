pub mod splat;
