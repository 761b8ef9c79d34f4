//! Whether triangles, pixels, voxels and photons are to each other as in the publication. A ratio of times moves with them: where a
//! picture shrinks and its triangles do not, another part of the frame decides.

use std::fmt;

use itertools::Itertools;

use crate::schema::{PublishedSizes, Test};
use crate::{Measure, measure};
use fathom_record::Cell;

/// Sizes count as balanced up to this factor between the one that was scaled most and the one that was scaled least. Twice is what a
/// mesh's next level of detail or a volume's next power of two costs.
const MOST_APART: f64 = 2.0;

/// Measured sizes over the published ones, from the least to the most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    low: f64,
    high: f64,
}

/// The cells that a test may look at, and their sizes over the published ones. A test that compares no cells takes those that are
/// balanced themselves; any other takes all or none.
pub(super) fn of<'a>(
    published: &[PublishedSizes],
    test: &Test,
    mut cells: Vec<&'a Cell>,
) -> Result<(Vec<&'a Cell>, Option<Scale>), String> {
    if let Test::AtLeast { .. } | Test::Within { .. } = test {
        let scales = cells.iter().map(|cell| Scale::of(published, &[cell]));
        let scales: Vec<Result<Scale, String>> = scales.collect();
        let mut kept = scales.iter().map(Result::is_ok);
        cells.retain(|_| kept.next().unwrap_or(false));
        let scale = scales.iter().flatten().copied().reduce(Scale::with);
        let fault = scales.into_iter().find_map(Result::err);
        return match (scale, fault) {
            (None, fault) => Err(fault.unwrap_or_else(|| "no measured cell".to_owned())),
            (scale, _) => Ok((cells, scale)),
        };
    }
    let scale = Scale::of(published, &cells)?;
    Ok((cells, Some(scale)))
}

impl Scale {
    /// Of cells that a claim compares. An error says which sizes are out of balance, or not known.
    fn of(published: &[PublishedSizes], cells: &[&Cell]) -> Result<Scale, String> {
        let shares = cells.iter().filter(|cell| cell.measured().is_some());
        let shares: Vec<Vec<Share<'_>>> =
            shares.map(|cell| of_cell(published, cell)).try_collect()?;
        let by_size = |a: &&Share<'_>, b: &&Share<'_>| a.share.total_cmp(&b.share);
        let ends = shares.iter().flatten().minmax_by(by_size).into_option();
        let (least, most) = ends.ok_or("no measured cell")?;
        if most.share > MOST_APART * least.share {
            return Err(format!("other balance: {most}, but {least}"));
        }
        Ok(Scale { low: least.share, high: most.share })
    }

    pub(super) fn join(scales: &[Scale]) -> Option<Scale> {
        scales.iter().copied().reduce(Scale::with)
    }

    fn with(self, other: Scale) -> Scale {
        Scale { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
}

impl fmt::Display for Scale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = [self.low, self.high].map(|share| format!("{:.2}", share));
        if low == high {
            write!(f, "at {low} times the published sizes")
        } else {
            write!(f, "at {low} to {high} times the published sizes")
        }
    }
}

/// One size of a cell over the published one.
struct Share<'a> {
    cell: &'a Cell,
    measure: &'a Measure,
    share: f64,
}

impl fmt::Display for Share<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.2} times the published {} in {}", self.share, self.measure, self.cell.cell)
    }
}

fn of_cell<'a>(published: &'a [PublishedSizes], cell: &'a Cell) -> Result<Vec<Share<'a>>, String> {
    let sizes = published.iter().filter(|sizes| measure::fits(cell, &sizes.filter));
    let shares = sizes.flat_map(|sizes| &sizes.sizes).map(|(measure, published)| {
        let size = cell.measured().and_then(|measured| measure.read(cell, measured));
        let size =
            size.ok_or_else(|| format!("the balance is not known: no {measure} in {}", cell.cell))?;
        Ok(Share { cell, measure, share: size.median() / published })
    });
    let shares: Vec<Share<'a>> = shares.collect::<Result<_, String>>()?;
    if shares.len() < 2 {
        return Err(format!(
            "the balance is not known: fewer than two published sizes for {}",
            cell.cell
        ));
    }
    Ok(shares)
}
