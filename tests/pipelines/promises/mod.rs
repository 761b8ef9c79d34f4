//! What promises the same answer by other means, over random settings and scenes: culling, fitted starts, another rasterizer,
//! a scene at another scale, kept answers. `FATHOM_DRAWS` sets the number of draws; each draw's seed is its number, so a failure names what to repeat.

mod answers;
mod ao;
mod light;
mod photons;
mod refraction;
mod scaled;
mod underwater;

/// Random draws of each promise.
pub fn draws() -> u64 {
    std::env::var("FATHOM_DRAWS").map_or(10, |text| text.parse().expect("FATHOM_DRAWS: a number"))
}
