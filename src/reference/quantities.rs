//! Error statistics of photons read back from the GPU against exact landings.

use glam::DVec3;

use super::photons::Landing;

/// A residual above this counts as not converged, metres.
pub const CONVERGED_M: f64 = 0.01;

/// A photon as the GPU stores it: 32 bytes, eight little-endian f32.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StoredPhoton {
    pub entry: DVec3,
    /// ≥ 0: |p_e − p_proj| after the last iteration; −1: never enters the water; −2: left the light's frustum.
    pub residual_m: f64,
    pub hit: DVec3,
    /// From entry to hit.
    pub distance_m: f64,
}

impl StoredPhoton {
    /// The photon landed somewhere, converged or not.
    pub fn landed(&self) -> bool {
        self.residual_m >= 0.0
    }

    pub fn converged(&self) -> bool {
        self.landed() && self.residual_m <= CONVERGED_M
    }
}

/// Photons of a buffer read back; bytes after the last whole photon are ignored.
pub fn stored_photons(bytes: &[u8]) -> Vec<StoredPhoton> {
    bytes
        .chunks_exact(32)
        .map(|chunk| {
            let (words, _) = chunk.as_chunks::<4>();
            let f = |i: usize| f64::from(f32::from_le_bytes(words[i]));
            StoredPhoton {
                entry: DVec3::new(f(0), f(1), f(2)),
                residual_m: f(3),
                hit: DVec3::new(f(4), f(5), f(6)),
                distance_m: f(7),
            }
        })
        .collect()
}

/// Photons of the GPU held against exact ones. Rates are shares of all photons that land exactly.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PhotonErrors {
    pub photons: usize,
    /// Photons that land by the exact answer.
    pub exact_landed: usize,
    /// Photons that land by both: those whose errors are counted.
    pub compared: usize,
    /// |hit − exact hit|, metres.
    pub median_m: f64,
    pub p99_m: f64,
    pub max_m: f64,
    /// 99th percentile over the photons whose estimate converged, metres.
    pub converged_p99_m: f64,
    /// 99th percentile of |entry − exact entry|, metres.
    pub entry_p99_m: f64,
    /// Land exactly, lost on the GPU.
    pub miss_rate: f64,
    /// Land on the GPU, not exactly; share of all photons.
    pub false_hit_rate: f64,
    /// Land on the GPU with a residual above [`CONVERGED_M`].
    pub unconverged_rate: f64,
}

/// Compares photons pairwise: both slices in the grid's memory order.
pub fn photon_errors(stored: &[StoredPhoton], exact: &[Landing]) -> PhotonErrors {
    let mut hit_errors = Vec::new();
    let mut converged_errors = Vec::new();
    let mut entry_errors = Vec::new();
    let (mut exact_landed, mut missed, mut false_hits, mut unconverged) = (0, 0, 0, 0);
    for (gpu, exact) in stored.iter().zip(exact) {
        match (gpu.landed(), exact.landed()) {
            (true, Some(landed)) => {
                let error = (gpu.hit - landed.hit.position).length();
                hit_errors.push(error);
                converged_errors.extend(gpu.converged().then_some(error));
                entry_errors.push((gpu.entry - landed.entry.position).length());
                unconverged += usize::from(!gpu.converged());
            }
            (false, Some(_)) => missed += 1,
            (true, None) => false_hits += 1,
            (false, None) => {}
        }
        exact_landed += usize::from(exact.landed().is_some());
    }
    let share = |count: usize, of: usize| count as f64 / of.max(1) as f64;
    PhotonErrors {
        photons: stored.len().min(exact.len()),
        exact_landed,
        compared: hit_errors.len(),
        median_m: quantile(&mut hit_errors, 0.5),
        p99_m: quantile(&mut hit_errors, 0.99),
        max_m: quantile(&mut hit_errors, 1.0),
        converged_p99_m: quantile(&mut converged_errors, 0.99),
        entry_p99_m: quantile(&mut entry_errors, 0.99),
        miss_rate: share(missed, exact_landed),
        false_hit_rate: share(false_hits, stored.len().min(exact.len())),
        unconverged_rate: share(unconverged, exact_landed),
    }
}

/// Nearest-rank quantile, `share` in 0…1; NaN for no values. A NaN among them counts as the largest.
pub fn quantile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    values.sort_by(f64::total_cmp);
    let rank = (share * values.len() as f64).ceil() as usize;
    values[rank.clamp(1, values.len()) - 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_nearest_rank() {
        assert!(quantile(&mut [], 0.5).is_nan());
        assert_eq!(quantile(&mut [3.0, 1.0, 2.0], 0.5), 2.0);
        assert_eq!(quantile(&mut [3.0, 1.0, 2.0], 0.0), 1.0);
        assert!(quantile(&mut [f64::NAN, 1.0], 1.0).is_nan());
    }
}
