pub mod march;
pub mod rasterize;
pub mod reduce;
