//! `ao/query`: point by point against the f64 twin, and variants that must agree.

use super::*;
use fathom_stages::ao::query::INFO;
use fathom_stages::marching::Step;
use fathom_stages::voxel::mips;

/// Sums of 32 terms in f32, and directions by sine and cosine that WGSL bounds to 2⁻¹¹.
const TOLERANCE: f64 = 5e-4;
const SIDE: u32 = 32;
const OPAQUE: u8 = 255;
const GLASS: u8 = 90;

type Change = fn(&mut Marching);

/// What the shader's definitions choose between.
const VARIANTS: [(&str, Change); 13] = [
    ("defaults", |_| ()),
    ("settings of VAO §5.1", paper),
    ("uniform directions, doubled", |m| m.estimator = Estimator::Uniform),
    ("look-ups moved", |m| m.shift_voxels = -0.3),
    ("guard none", |m| m.guard = Guard::None),
    ("guard of a voxel", |m| m.guard = Guard::Voxel),
    ("guard of seven voxels", |m| m.guard = Guard::SevenVoxels),
    ("hard attenuation", |m| m.attenuation = Attenuation::Hard),
    ("random directions", |m| m.sampling = Sampling::Random),
    ("steps of half a voxel", |m| m.step_voxels = 0.5),
    ("a low threshold", |m| m.threshold = 0.55),
    ("jitter", |m| m.jitter = true),
    ("another seed", |m| m.seed = 3),
];

fn paper(m: &mut Marching) {
    m.estimator = Estimator::Paper;
    m.step = Step::Paper;
    m.hit = Hit::Sample;
    m.offset_voxels = 0.0;
    m.sampling = Sampling::Random;
}

pub fn cases() -> Vec<Case> {
    let what = |(name, _)| format!("against the f64 twin, {name}");
    let twins = Case::each(INFO.name, VARIANTS, what, against_twin);
    twins
        .chain([
            Case::new(INFO.name, "opacities against the f64 twin", opacities),
            Case::new(INFO.name, "opacities at other steps than a voxel", opacity_steps),
            Case::new(INFO.name, "rays of several passes", many_rays),
            Case::new(INFO.name, "skipping and not skipping", skipping),
        ])
        .collect()
}

/// Points of the furnished volume: A as the stage finds it, and what its twin needs.
struct Marched {
    host: HostVolume,
    points: Vec<(DVec3, DVec3)>,
    found: Vec<f64>,
    march: March,
    /// Added to a point's number where it seeds directions, as by `seed_of` in shaders/shared/marching.wgsl.
    seed: u32,
}

impl Marched {
    fn new(rig: &Rig<'_>, level: u8, count: usize, settings: &Marching) -> Result<Self> {
        let subject = MarchedVolume::new(rig, SIDE, level, furnished)?;
        let mut points = furnished_points();
        points.truncate(count);
        let found = query(rig, &subject.voxels, &points, settings)?;
        let march = twin(settings, &subject.host.grid);
        let seed = settings.seed.wrapping_mul(0x9E37_79B9);
        Ok(Self { host: subject.host, points, found, march, seed })
    }

    /// Largest distance of a share of A from the twin's, from points moved along the normals, beyond what rounding of V explains.
    fn beyond(&self, share: f64, nudge_m: f64) -> f64 {
        let found = (0..).zip(&self.points).zip(&self.found);
        largest(found.map(|((i, (p, n)), value)| {
            beyond(share * value, &self.march, DENSITY_ERROR, |march| {
                march.from(&self.host, *p + *n * nudge_m, *n, self.seed.wrapping_add(i)).occlusion
            })
        }))
    }

    /// RMS of the difference from another twin, over this volume.
    fn rms(&self, march: &March, host: &HostVolume) -> f64 {
        let found = (0..).zip(&self.points).zip(&self.found);
        rms(found.map(|((i, (p, n)), value)| value - march.from(host, *p, *n, i).occlusion))
    }

    fn mean(&self) -> f64 {
        mean(self.found.iter().copied())
    }
}

fn against_twin(rig: &Rig<'_>, (name, change): (&str, Change)) -> Result<Check> {
    let marched = Marched::new(rig, OPAQUE, usize::MAX, &marching(change))?;
    Ok(Check::of(rig, format!("largest |GPU − f64 twin| of A, {name}"))
        .within((TOLERANCE, "1"), marched.beyond(1.0, 0.0))
        .control(
            "the twin's points 0.3 voxels higher",
            marched.beyond(1.0, 0.3 * marched.host.grid.voxel_m),
        )
        .with("mean", marched.mean()))
}

fn many_rays(rig: &Rig<'_>) -> Result<Check> {
    let settings = Marching { rays: MANY_RAYS, ..marching(|_| ()) };
    let marched = Marched::new(rig, OPAQUE, 12, &settings)?;
    Ok(Check::of(rig, format!("largest |GPU − f64 twin| of A, {MANY_RAYS} rays"))
        .within((TOLERANCE, "1"), marched.beyond(1.0, 0.0))
        .control("a fifth of what the rays meet left out", marched.beyond(0.8, 0.0))
        .with("mean", marched.mean()))
}

/// A sample of falling opacity that rounding makes a rising one changes a ray by up to its opacity, 0.35: the share of such samples is that
/// of V's error, 1 / 64, of which 32 rays take the mean.
const OPACITY_RMS: f64 = 5e-3;

fn glass(rig: &Rig<'_>, step_voxels: Option<f64>) -> Result<Marched> {
    let settings = marching(|m| {
        m.occluder = Occluder::Opacity;
        m.threshold = 1.0;
        m.step_voxels = step_voxels.unwrap_or(m.step_voxels);
    });
    Marched::new(rig, GLASS, usize::MAX, &settings)
}

fn opacities(rig: &Rig<'_>) -> Result<Check> {
    let marched = glass(rig, None)?;
    let rms = |alpha_scale: f64| {
        let values = marched.host.values.iter().map(|v| v * alpha_scale).collect();
        marched.rms(&marched.march, &HostVolume { grid: marched.host.grid, values })
    };
    Ok(Check::of(rig, "RMS of GPU − f64 twin of A, opacities")
        .within((OPACITY_RMS, "1"), rms(1.0))
        .control("the twin's opacities 1.1 times", rms(1.1)))
}

/// Eq. 7's exponent is the step over the voxel: steps of other lengths than a voxel show whether it is there.
fn opacity_steps(rig: &Rig<'_>) -> Checks {
    let check = |step_voxels: f64| {
        let marched = glass(rig, Some(step_voxels))?;
        let rms =
            |exponent| marched.rms(&March { exponent, ..marched.march.clone() }, &marched.host);
        Ok(Check::of(rig, format!("RMS of GPU − f64 twin of A, opacities, steps of {step_voxels}"))
            .within((OPACITY_RMS, "1"), rms(step_voxels))
            .control("the twin's exponent 1", rms(1.0))
            .with("mean", marched.mean()))
    };
    [0.5, 2.0].into_iter().map(check).collect()
}

fn skipping(rig: &Rig<'_>) -> Checks {
    let subject = MarchedVolume::new(rig, SIDE, OPAQUE, furnished)?;
    let points = furnished_points();
    let run = |change: Change, skipping| {
        let settings = Marching { skipping, ..marching(change) };
        query(rig, &subject.voxels, &points, &settings)
    };
    // The pyramid is not filled yet and says that all is empty.
    let blind = run(|_| (), true)?;
    let mips = mips::new(rig, std::slice::from_ref(&subject.voxels))?;
    rig.run(&[&mips])?;
    let variants: [(&str, Change); 2] =
        [("defaults", |_| ()), ("opacities", |m| m.occluder = Occluder::Opacity)];
    let check = |(name, change): (&str, Change)| {
        let (plain, skipping) = (run(change, false)?, run(change, true)?);
        let differ = |values: &[f64]| differing(&plain, values);
        Ok(Check::of(rig, format!("points whose A skipping changes, {name}"))
            .within((0.0, "1"), differ(&skipping))
            .control("the pyramid empty", differ(&blind)))
    };
    variants.into_iter().map(check).collect()
}
