//! What is done with the final image.

pub mod luminance;
