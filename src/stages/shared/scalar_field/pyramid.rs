//! Averages of a field over ever larger cells. VAO §5.2.3.

/// Levels of a full pyramid, the field itself counted.
pub fn levels(cells: [u32; 3]) -> u32 {
    cells.into_iter().max().unwrap_or(1).max(1).ilog2() + 1
}

/// The next level: half the cells along each axis, rounded down but at least one. Each is the mean of the field over its box,
/// so that the mean of all stays what it was.
pub fn coarser(cells: [u32; 3], values: &[f32]) -> ([u32; 3], Vec<f32>) {
    let mut cells = cells;
    let mut values = values.to_vec();
    for axis in 0..3 {
        let fewer = (cells[axis] / 2).max(1);
        values = averaged(cells, &values, axis, fewer);
        cells[axis] = fewer;
    }
    (cells, values)
}

/// The field with `fewer` cells along one axis, each the mean over its box.
fn averaged(cells: [u32; 3], values: &[f32], axis: usize, fewer: u32) -> Vec<f32> {
    let taps: Vec<Vec<(usize, f32)>> =
        (0..fewer).map(|i| overlaps(cells[axis], fewer, i)).collect();
    let stride: usize = cells[..axis].iter().map(|n| *n as usize).product();
    let run = stride * cells[axis] as usize;
    let mut means = Vec::with_capacity(values.len() / cells[axis] as usize * fewer as usize);
    for block in values.chunks_exact(run) {
        for taps in &taps {
            let mean = |i| -> f32 { taps.iter().map(|(j, w)| block[j * stride + i] * w).sum() };
            means.extend((0..stride).map(mean));
        }
    }
    means
}

/// The cells that box `i` of `fewer` overlaps, each with its share of the box.
fn overlaps(cells: u32, fewer: u32, i: u32) -> Vec<(usize, f32)> {
    let edge = f64::from(cells) / f64::from(fewer);
    let (low, high) = (f64::from(i) * edge, f64::from(i + 1) * edge);
    let share = |j: u32| {
        let (from_cell, to_cell) = (f64::from(j), f64::from(j + 1));
        (high.min(to_cell) - low.max(from_cell)).max(0.0) / edge
    };
    (0..cells).map(|j| (j as usize, share(j) as f32)).filter(|(_, share)| *share > 1e-6).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_keeps_the_mean_of_odd_sizes() {
        let values: Vec<f32> = (0..105).map(|i| ((i * 37) % 101) as f32).collect();
        let mut level = ([7, 5, 3], values);
        let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
        let whole = mean(&level.1);
        let sizes = [[3, 2, 1], [1, 1, 1]];
        assert_eq!(levels(level.0), 1 + sizes.len() as u32);
        for size in sizes {
            level = coarser(level.0, &level.1);
            assert_eq!(level.0, size);
            assert!((mean(&level.1) - whole).abs() < 1e-3, "{size:?}");
        }
    }
}
