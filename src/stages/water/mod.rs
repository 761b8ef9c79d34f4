pub mod reflection;
pub mod refraction;
