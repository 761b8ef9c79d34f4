//! Whether triangles, pixels, voxels and photons are to each other as in the publication. A ratio of times moves with them: where a
//! picture shrinks and its triangles do not, another part of the frame decides.

use std::fmt;

use itertools::Itertools;

use crate::schema::{PublishedSizes, Test};
use crate::{Measure, measure};
use fathom_record::Cell;

/// Sizes count as balanced up to this factor between the one that was scaled most and the one that was scaled least. Twice is what a
/// mesh's next level of detail or a volume's next power of two costs.
const MAX_APART: f64 = 2.0;

/// Measured sizes over the published ones, from the least to the most.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SizeRatios {
    low: f64,
    high: f64,
}

/// The cells that a test may look at, and their sizes over the published ones. A test that compares no cells takes those that are
/// balanced themselves; any other takes all or none.
pub(super) fn select<'a>(
    published: &[PublishedSizes],
    test: &Test,
    mut cells: Vec<&'a Cell>,
) -> Result<(Vec<&'a Cell>, Option<SizeRatios>), String> {
    if let Test::Within { .. } = test {
        let scales = cells.iter().map(|cell| SizeRatios::from_cells(published, &[cell]));
        let scales: Vec<Result<SizeRatios, String>> = scales.collect();
        let mut kept = scales.iter().map(Result::is_ok);
        cells.retain(|_| kept.next().unwrap_or(false));
        let scale = scales.iter().flatten().copied().reduce(SizeRatios::with);
        let fault = scales.into_iter().find_map(Result::err);
        return match (scale, fault) {
            (None, fault) => Err(fault.unwrap_or_else(|| "no measured cell".to_owned())),
            (scale, _) => Ok((cells, scale)),
        };
    }
    let scale = SizeRatios::from_cells(published, &cells)?;
    Ok((cells, Some(scale)))
}

impl SizeRatios {
    /// Of cells that a claim compares. An error says which sizes are out of balance, or not known.
    fn from_cells(published: &[PublishedSizes], cells: &[&Cell]) -> Result<SizeRatios, String> {
        let shares = cells.iter().filter(|cell| cell.measured().is_some());
        let shares: Vec<Vec<Share<'_>>> =
            shares.map(|cell| ratios(published, cell)).try_collect()?;
        let by_size = |a: &&Share<'_>, b: &&Share<'_>| a.share.total_cmp(&b.share);
        let ends = shares.iter().flatten().minmax_by(by_size).into_option();
        let (least, most) = ends.ok_or("no measured cell")?;
        if most.share > MAX_APART * least.share {
            return Err(format!("other balance: {most}, but {least}"));
        }
        Ok(SizeRatios { low: least.share, high: most.share })
    }

    pub(super) fn join(scales: &[SizeRatios]) -> Option<SizeRatios> {
        scales.iter().copied().reduce(SizeRatios::with)
    }

    fn with(self, other: SizeRatios) -> SizeRatios {
        SizeRatios { low: self.low.min(other.low), high: self.high.max(other.high) }
    }
}

impl fmt::Display for SizeRatios {
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

fn ratios<'a>(published: &'a [PublishedSizes], cell: &'a Cell) -> Result<Vec<Share<'a>>, String> {
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

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::super::Verdict::{Contradicted, NotRun, Supported};
    use super::super::tests::{SWEPT, swept};
    use super::super::{ClaimOrigin, Ruling, Verdict};
    use crate::fixtures::own;

    /// Claims on cells at two triangle counts, tested with the publication's method and at its balance.
    const PUBLISHED: &str = r#"
        [method]
        filter = false
        [[balance]]
        sizes = { "param:pixels" = 400.0 }
        [[balance]]
        where = { n = 1 }
        sizes = { "param:triangles" = 1000.0 }
        [[balance]]
        where = { n = 2 }
        sizes = { "param:triangles" = 4000.0 }
        [[claim]]
        id = "ratio"
        text = "x"
        source = "UW Table 1"
        balance = "published"
        test.ratio = { y = "stage:s", over = "n", numerator = 2, denominator = 1, low = 1.5, high = 2.5 }
        [[claim]]
        id = "free"
        text = "x"
        source = "UW Table 1"
        balance = "free: the test counts"
        test.ratio = { y = "stage:s", over = "n", numerator = 2, denominator = 1, low = 1.5, high = 2.5 }
        [[claim]]
        id = "own"
        text = "x"
        test.ratio = { y = "stage:s", over = "n", numerator = 2, denominator = 1, low = 1.5, high = 2.5 }
        "#;

    fn published(params: [Value; 2]) -> Vec<Ruling> {
        published_with("", params)
    }

    /// The same with one more claim.
    fn published_with(claim: &str, params: [Value; 2]) -> Vec<Ruling> {
        let experiment = own(&format!("{SWEPT}{PUBLISHED}{claim}"));
        let mut cells = swept(&[1.0, 2.0], |n| 2.0 * n);
        for (cell, params) in cells.iter_mut().zip(params) {
            cell.params = params.into();
        }
        experiment.rulings(&cells.iter().collect::<Vec<_>>(), false)
    }

    fn sizes(pixels: f64, triangles: f64) -> Value {
        json!({ "pixels": pixels, "triangles": triangles, "filter": false })
    }

    #[test]
    fn a_claim_is_tested_at_the_publications_balance_only() {
        // A quarter of all sizes, up to rounding.
        let rulings = published([sizes(100.0, 250.0), sizes(100.0, 1100.0)]);
        assert!(rulings.iter().all(|ruling| ruling.verdict == Supported), "{rulings:?}");
        let scale = rulings[0].scale.unwrap().to_string();
        assert_eq!(scale, "at 0.25 to 0.28 times the published sizes");
        assert_eq!(rulings[1].scale, None);
        // Pictures that shrank while triangles did not; and one of the two cells at another scale than the other.
        for params in [
            [sizes(100.0, 1000.0), sizes(100.0, 4000.0)],
            [sizes(400.0, 1000.0), sizes(100.0, 1000.0)],
        ] {
            let rulings = published(params);
            let verdicts: Vec<Verdict> = rulings.iter().map(|ruling| ruling.verdict).collect();
            assert_eq!(verdicts, [NotRun, Supported, Supported]);
            assert!(rulings[0].reason.starts_with("other balance: "), "{}", rulings[0].reason);
        }
        let unknown = json!({ "pixels": 100.0, "filter": false });
        let [ruling, ..] = &published([unknown, sizes(100.0, 1000.0)])[..] else { panic!() };
        assert_eq!(ruling.verdict, NotRun);
        assert!(ruling.reason.starts_with("the balance is not known: "), "{}", ruling.reason);
    }

    #[test]
    fn a_bound_on_every_cell_is_tested_on_the_balanced_ones() {
        let claim = r#"
            [[claim]]
            id = "each"
            text = "x"
            source = "UW Table 1"
            balance = "published"
            test.within = { y = "quantity:error", low = 0.0, high = 3.0 }
            "#;
        let verdict = |params| published_with(claim, params).last().unwrap().verdict;
        // The errors are 2 and 4: the second cell contradicts the claim where it counts.
        assert_eq!(verdict([sizes(100.0, 250.0), sizes(100.0, 1000.0)]), Contradicted);
        assert_eq!(verdict([sizes(100.0, 250.0), sizes(100.0, 4000.0)]), Supported);
        assert_eq!(verdict([sizes(100.0, 1000.0), sizes(100.0, 4000.0)]), NotRun);
    }

    #[test]
    fn a_publications_claim_is_tested_with_its_method_only() {
        let other =
            |pixels, triangles| json!({ "pixels": pixels, "triangles": triangles, "filter": true });
        let rulings = published([other(400.0, 1000.0), other(400.0, 4000.0)]);
        let verdicts: Vec<Verdict> = rulings.iter().map(|ruling| ruling.verdict).collect();
        assert_eq!(verdicts, [NotRun, NotRun, Supported]);
        assert_eq!(rulings[1].reason, "no cell runs the publication's method");
        let whose: Vec<ClaimOrigin> = rulings.iter().map(|ruling| ruling.origin).collect();
        assert_eq!(whose, [ClaimOrigin::Publication, ClaimOrigin::Publication, ClaimOrigin::Own]);
    }
}
