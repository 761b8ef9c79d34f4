//! What a dump of a stage says besides the stage's own outputs; `docs/dumps.md` has the meaning of each key.

use glam::{DMat4, DVec3};
use serde_json::{Value, json};

use super::{GridSettings, IntensityRule, Underwater};
use fathom_scene::LightFrame;

impl Underwater {
    /// Camera and light for every stage; for those of caustics and godrays also what their photons carry and how they are
    /// drawn.
    pub(super) fn explained(&self, stage: &str) -> Value {
        let view = &self.view;
        let mut about = json!({
            "camera": {
                "position_m": view.camera.position_m,
                "view_projection": rows(view.camera.view_projection(view.aspect())),
                "viewport_px": view.size_px.to_array(),
                "z_near_m": view.camera.z_near_m,
                "z_far_m": view.camera.z_far_m,
            },
            "light_frustum": light_frustum(&view.light_frame()),
        });
        match stage.split('/').next() {
            Some("caustics") => {
                let (settings, splat) = (&self.params.caustics, &self.plan.splat);
                let grid = settings.grid_settings();
                about["photons"] = self.photons(&grid, settings.intensity, splat.photon_w);
                about["splat"] = json!({
                    "size_a_px": splat.size_a_px,
                    "size_b_px_m": splat.size_b_px_m,
                    "buffer_px": splat.size_px.as_uvec2().to_array(),
                    "depth_bias_m": splat.depth_bias_m,
                    "coverage": settings.coverage,
                });
                about["irradiance"] = json!({"scale": self.plan.compose.caustics_scale});
            }
            Some("godrays") => {
                let (settings, lines) = (&self.params.godrays, &self.plan.lines);
                let grid = settings.grid_settings();
                about["photons"] = self.photons(&grid, settings.intensity, lines.photon_w);
                about["line"] = json!({
                    "width_px": lines.width_px,
                    "square_px": lines.square_px.to_array(),
                    "phase_k": lines.phase_k,
                    "buffer_px": lines.size_px.as_uvec2().to_array(),
                });
                about["radiance"] = json!({
                    "scale": self.plan.compose.godrays_scale,
                    "distance_m": self.params.middle_m(),
                });
            }
            _ => {}
        }
        about
    }

    fn photons(&self, grid: &GridSettings, intensity: IntensityRule, flux_w: f32) -> Value {
        let water = &self.view.water;
        json!({
            "count": grid.photons(),
            "flux_w": flux_w,
            "attenuation_per_m": water.attenuation_per_m,
            "fresnel": water.fresnel,
            "refractive_index": water.refractive_index,
            "intensity": intensity,
        })
    }
}

/// Matrices, place and extents of the light's frustum.
fn light_frustum(frame: &LightFrame) -> Value {
    let inverse = frame.projection.inverse();
    let corner = |x, y, depth| inverse.project_point3(DVec3::new(x, y, depth));
    let (low, high, far) = (corner(-1.0, -1.0, 0.0), corner(1.0, 1.0, 0.0), corner(0.0, 0.0, 1.0));
    json!({
        "kind": frame.kind,
        "position_m": frame.position.to_array(),
        "forward": frame.forward.to_array(),
        "view": rows(frame.view),
        "view_projection": rows(frame.view_projection),
        "inverse": rows(frame.inverse),
        "photon_grid": rows(frame.photon_grid),
        "grid_area": frame.grid_area,
        "extents": {
            "near_m": -low.z,
            "far_m": -far.z,
            "near_min_m": [low.x, low.y],
            "near_max_m": [high.x, high.y],
        },
        "emitted_w": frame.emitted_w,
    })
}

fn rows(matrix: DMat4) -> [[f64; 4]; 4] {
    matrix.transpose().to_cols_array_2d()
}
