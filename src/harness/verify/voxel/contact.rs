//! `voxel/overlap` and `voxel/alpha` against separating axes in f64.

use super::subjects::{Subject, voxels_of, words};
use crate::harness::verify::rig::Rig;
use crate::harness::verify::{Case, Check, VerifyError};
use crate::reference::voxel::{Contact, Errors, errors, gaps};
use crate::scene::Grid;
use crate::stages::voxel::overlap::Overlap;

const OVERLAP: &str = "voxel/overlap";

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(OVERLAP, "conservative", |rig| overlap(rig, false)),
        Case::new(OVERLAP, "thin", |rig| overlap(rig, true)),
    ]
}

fn overlap(rig: &Rig<'_>, thin: bool) -> Result<Vec<Check>, VerifyError> {
    let (contact, variant) = if thin {
        (Contact::Lines, "thin")
    } else {
        (Contact::Cube, "conservative")
    };
    let mut checks = Vec::new();
    for subject in [Subject::soup()?, Subject::bunny(32)?, Subject::bunny(64)?] {
        let resources = rig.resources();
        let (geometry, part) = subject.upload(&resources);
        let bits = part.voxels.bits.clone();
        let stage = Overlap::new(&resources, &geometry, &[part], thin)?;
        rig.run(&[&stage])?;
        let found = voxels_of(&words(rig, &bits)?, &subject.grid);
        let triangles = subject.triangles();
        let against = |grid: &Grid| errors(&found, &gaps(&triangles, grid, contact));
        checks.extend(no_errors(&subject, variant, against));
    }
    Ok(checks)
}

/// No false negatives and no false positives outside the borderline band.
fn no_errors(subject: &Subject, variant: &str, against: impl Fn(&Grid) -> Errors) -> Vec<Check> {
    let resolution = subject.grid.cells.into_iter().max().unwrap_or(0);
    let name = format!("{variant}, {} {resolution}", subject.name);
    let [exact, perturbed] = [against(&subject.grid), against(&subject.moved(0.02))];
    let control = "grid moved by 0.02 voxels";
    vec![
        Check::new(
            (OVERLAP, format!("{name}: voxels missed")),
            (0.0, "1"),
            exact.false_negatives as f64,
            (control, perturbed.false_negatives as f64),
        )
        .with("occupied_voxels", exact.occupied as f64)
        .with("borderline_voxels", exact.borderline as f64),
        Check::new(
            (OVERLAP, format!("{name}: voxels too many")),
            (0.0, "1"),
            exact.false_positives as f64,
            (control, perturbed.false_positives as f64),
        ),
    ]
}
