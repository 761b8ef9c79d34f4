//! Exits from glass in screen space, against exact ray tracing.

use fathom::verify::refraction::{WRONG, solid_errors};
use fathom::verify::rig::{Random, Rig};

/// From random solids, convex and not, of indices from 1 on, with any number of steps. At index 1 all are exact; of the others up to 1 %
/// leave where no pixel's middle shows the face.
#[test]
fn exits_from_random_solids_are_exact() {
    let gpu = super::super::gpu();
    let rig = Rig::new(&gpu, "refraction/trace");
    let (mut wrong, mut all, mut moved) = (0, 0, 0);
    for draw in 0..super::draws() as u32 {
        let least = Random::new(draw).within(1.0, 64.0) as u32;
        let errors = solid_errors(&rig, 18 + draw, least).unwrap();
        let [found, turned] = errors.each_ref().map(|e| e.iter().filter(|e| **e > WRONG).count());
        let (exits, is_straight) = (errors[0].len(), draw / 3 % 3 == 0);
        assert!(
            !is_straight || found * 200 < exits,
            "draw {draw}, {least} steps: {found} of {exits}"
        );
        (wrong, all, moved) = (wrong + found, all + exits, moved + turned);
    }
    assert!(wrong * 50 < all, "{wrong} of {all} exits are wrong");
    assert!(moved * 10 > all, "the control, an index 5 % higher, moves {moved} of {all}");
}
