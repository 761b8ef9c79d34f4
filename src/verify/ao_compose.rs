//! `ao/compose`: each pixel of the picture against an f64 evaluation from known buffers.

use crate::prelude::*;
use fathom_reference::image::pixel_behind;
use fathom_stages::ao::compose::{self, LitInputs};
use fathom_stages::picture::Picture;

const SIZE: [u32; 2] = [96, 64];
/// Of the buffer of visibility.
const VISIBILITY: [u32; 2] = [61, 41];
/// Irradiance of the ambient light over that of the direct light.
const AMBIENT: f64 = 0.4;
const EXPOSURE: f64 = 0.2;
/// Of depths in 32-bit floats.
const ROUNDING: f64 = 2e-6;

pub fn cases() -> Vec<Case> {
    let kinds = [LightKind::Directional, LightKind::Point];
    let what = |kind| format!("pixel by pixel, {kind:?} light");
    let unshaded = Case::new(compose::INFO.name, "a plane in slanted light", unshaded);
    Case::each(compose::INFO.name, kinds, what, known_inputs).chain([unshaded]).collect()
}

/// The tank with noise for its surfaces and its visibility, in a shadow map so coarse that most of what is seen lies between its texels.
fn known_inputs(rig: &Rig<'_>, kind: LightKind) -> Checks {
    const TEXELS: u32 = 48;
    let mut scene = Scene::load("tank")?;
    scene.light.kind = kind;
    // Fitted to what is seen, or narrower.
    scene.light.half_extent_m = if kind == LightKind::Point { 0.0 } else { 2.5 };
    // From above, so that the sky is seen too.
    scene.camera = Camera::new([0.6, 2.5, 6.5], [0.0, -0.6, 0.0], 65.0, [0.5, 16.0]);
    let fixture = rig.fixture(scene, SIZE)?;
    let known = NoisySurfaces::new(rig, &fixture, |_| DVec3::ZERO)?;
    let open = noise(VISIBILITY, 31);
    let map = shadow::depth::new(rig, &fixture.shared, &fixture.geometry, TEXELS)?;
    let depths = rig.draw(&[&map], map.texture(), 0)?;
    let draw = |shows_occlusion: bool| -> Result<Texels> {
        let lit = LitInputs {
            picture: Picture::new(&known.gbuffer, EXPOSURE, AMBIENT),
            visibility: &rig.grey(&open),
            shadow: map.texture(),
        };
        let stage = compose::new(rig, &fixture.shared, &lit, shows_occlusion)?;
        Texels::draw(rig, &stage)
    };
    let light_rays =
        PixelRays::of_matrix(fixture.view.light_frame().view_projection, TEXELS, TEXELS);
    let lit = LitSurfaces { known: &known, open: &open, depths: &depths, light_rays };
    let (shown, occlusion) = (draw(false)?, draw(true)?);
    let error = |gloss| largest_excess(&shown, |at| lit.allowed(at, gloss));
    let occluded = |scale: f64| {
        largest_excess(&occlusion, |at| {
            let grey = known.seen(at).map_or_else(|| lit.background(at), |_| scale * lit.open(at));
            vec![DVec3::splat(grey).extend(1.0)]
        })
    };
    Ok(vec![
        Check::new(rig, format!("{kind:?}: largest error of the picture"))
            .within((DISPLAY_STEP, "1"), error(32.0))
            .control("a gloss of 33", error(33.0)),
        Check::new(rig, format!("{kind:?}: largest error of the occlusion alone"))
            .within((DISPLAY_STEP, "1"), occluded(1.0))
            .control("1 % less of it", occluded(0.99)),
    ])
}

/// No plane lies in its own shadow. One as far above it as two texels of the map are wide lays a shadow on it.
fn unshaded(rig: &Rig<'_>) -> Result<Check> {
    const TEXELS: u32 = 1024;
    let mut scene = rig::flat_plane(LightKind::Directional)?;
    scene.light.direction = [1.0, -0.5, 0.7];
    let fixture = rig.fixture(scene.clone(), SIZE)?;
    let texel_m = 2.0 * scene.light.half_extent_m / f64::from(TEXELS);
    for position in scene.objects.iter_mut().flat_map(|object| &mut object.mesh.positions) {
        position[1] += 2.0 * texel_m as f32;
    }
    let above = Geometry::new(rig, &scene);
    let white = Texels::new(rig, SIZE, |_| DVec4::ONE).texture;
    let gbuffer = GBuffer { albedo: white.clone(), ..rig.gbuffer(&fixture)? };
    let dark = |caster| -> Result<f64> {
        let map = shadow::depth::new(rig, &fixture.shared, caster, TEXELS)?;
        let picture = Picture::new(&gbuffer, 0.3, 0.0);
        let lit = LitInputs { picture, visibility: &white, shadow: map.texture() };
        let stage = compose::new(rig, &fixture.shared, &lit, false)?;
        let shown = rig.draw(&[&map, &stage], stage.texture(), 0)?;
        let plane = pixels(SIZE).filter(|at| fixture.hit(*at).is_some()).map(|at| shown.get(at));
        let brightest = largest(plane.clone());
        Ok(share(plane.map(|shown| shown < 0.99 * brightest)))
    };
    Ok(Check::new(rig, "share of pixels in shadow")
        .within((0.0, "1"), dark(&fixture.geometry)?)
        .control("a plane two texels above it casts the shadow", dark(&above)?))
}

struct LitSurfaces<'a> {
    known: &'a NoisySurfaces<'a>,
    /// 1 − A.
    open: &'a Image,
    /// The shadow map, and rays through its texels.
    depths: &'a Image,
    light_rays: PixelRays,
}

impl LitSurfaces<'_> {
    /// Visibility of the texel behind a pixel.
    fn open(&self, (x, y): (u32, u32)) -> f64 {
        let [x, y] = pixel_behind([x.into(), y.into()], SIZE, VISIBILITY);
        self.open.clamped(x, y)
    }

    /// A grey that rises with the height of the line of sight (VAO shows white objects before it; tuned for its looks).
    fn background(&self, at: (u32, u32)) -> f64 {
        0.30 + (0.75 - 0.30) * 0.5 * (1.0 + self.known.sight(at).y)
    }

    /// With the least and the most light that may arrive.
    fn allowed(&self, at: (u32, u32), gloss: f64) -> Vec<DVec4> {
        let Some(seen) = self.known.seen(at) else {
            return vec![DVec3::splat(self.background(at)).extend(1.0)];
        };
        let light = &self.known.light;
        let to_light = light.to_light(seen.position);
        let half_vector = (to_light - self.known.sight(at)).normalize();
        // Blinn and Phong's lobe of a total near 1, (s + 8) / 8π (Real-Time Rendering, 3rd edition, chapter 7).
        let lobe = (gloss + 8.0) / (8.0 * PI) * seen.normal.dot(half_vector).max(0.0).powf(gloss);
        let specular = self.known.normal.get(at).w;
        let cosine = seen.normal.dot(to_light).max(0.0);
        let radiance = |share: f64| {
            let direct = (seen.albedo / PI + specular * lobe) * cosine * share;
            light.irradiance * (direct + seen.albedo / PI * AMBIENT * self.open(at))
        };
        self.lit_share(&seen).map(|share| displayed(radiance(share), EXPOSURE)).into()
    }

    /// Share of the direct light by the four texels of the map around the place, moved by 1.5 texels along its normal (Reeves, Salesin and Cook, *Rendering
    /// Antialiased Shadows with Depth Maps*, 1987); at least and at most, as rounding decides where depths are alike.
    fn lit_share(&self, seen: &SeenSurface) -> [f64; 2] {
        let (rays, side) = (&self.light_rays, f64::from(self.depths.width()));
        let Some(on) = rays.project(seen.position) else { return [f64::NAN; 2] };
        let width_m = |x: f64, y: f64| {
            rays.unproject(on.x_px + x, on.y_px + y, on.depth).distance(seen.position)
        };
        let moved = seen.position + 1.5 * width_m(1.0, 0.0).max(width_m(0.0, 1.0)) * seen.normal;
        let Some(on) = rays.project(moved) else { return [f64::NAN; 2] };
        let place = DVec2::new(on.x_px, on.y_px) / side;
        if place.min_element() < 0.0 || place.max_element() > 1.0 {
            return [1.0; 2];
        }
        let share = |rounding: f64| {
            let open = corners(place, [self.depths.width(); 2]).map(|(weight, [x, y])| {
                if self.depths.clamped(x, y) + rounding >= on.depth { weight } else { 0.0 }
            });
            open.into_iter().sum()
        };
        [share(-ROUNDING), share(ROUNDING)]
    }
}
