pub mod blur;
pub mod lines;
