//! What a dump of a stage says besides the stage's own outputs: enough to compute the buffers again from the photons.

use glam::{DMat4, DVec3};
use serde_json::{Value, json};

use super::{GridSettings, IntensityRule, Underwater};
use fathom_scene::LightFrame;
use fathom_stages::caustics::splat::SplatCoverage;

impl Underwater {
    /// Camera and light for every stage; for those of caustics and godrays also what their photons carry and how they are
    /// drawn.
    pub(super) fn explained(&self, stage: &str) -> Value {
        let mut about = json!({
            "camera": self.camera(),
            "light_frustum": light_frustum(&self.view.light_frame()),
        });
        match stage.split('/').next() {
            Some("caustics") => {
                let settings = &self.params.caustics;
                let (grid, intensity) = (settings.grid_settings(), settings.intensity);
                about["photons"] = self.photons(&grid, intensity, self.plan.splat.photon_w);
                about["splat"] = self.splat();
                about["irradiance"] = self.irradiance();
            }
            Some("godrays") => {
                let settings = &self.params.godrays;
                let (grid, flux_w) = (settings.grid_settings(), self.plan.lines.photon_w);
                about["photons"] = self.photons(&grid, settings.intensity, flux_w);
                about["line"] = self.line();
                about["radiance"] = json!({
                    "scale": self.plan.compose.godrays_scale,
                    "unit": "1/m² for a texel in the unit of its column",
                    "distance_m": self.params.middle_m(),
                    "meaning": "radiance that is composed, W/(m² sr): the texel times the scale, which takes each line as seen at \
                        distance_m and at right angles. What is scattered in along a line is that times distance_m / (z² * cos * turn): \
                        z of a point of the line along the view, cos between the sight and the view's direction, turn how far \
                        (x / z, y / z) in the camera's space moves in a metre of the line",
                });
            }
            _ => {}
        }
        about
    }

    fn camera(&self) -> Value {
        let view = &self.view;
        json!({
            "position_m": view.camera.position_m,
            "view_projection": rows(view.camera.view_projection(view.aspect())),
            "viewport_px": view.size_px.to_array(),
            "z_near_m": view.camera.z_near_m,
            "z_far_m": view.camera.z_far_m,
            "meaning": "clip = view_projection * (x, y, z, 1), the matrix by rows; ndc = clip.xyz / clip.w; pixel of a \
                buffer of w × h: ((ndc.x + 1) / 2 * w, (1 - ndc.y) / 2 * h)",
        })
    }

    fn photons(&self, grid: &GridSettings, intensity: IntensityRule, flux_w: f32) -> Value {
        json!({
            "count": grid.photons(),
            "flux_w": flux_w,
            "attenuation_per_m": self.view.water.attenuation_per_m,
            "fresnel": self.view.water.fresnel,
            "refractive_index": self.view.water.refractive_index,
            "intensity": intensity,
            "energy": "flux that a photon brings to its landing point, W: flux_w * weight * exp(-attenuation_per_m * distance_m); \
                weight is a column of the trace's output; photons with a negative residual bring none",
        })
    }

    fn splat(&self) -> Value {
        let splat = &self.plan.splat;
        let value = match self.params.caustics.intensity {
            IntensityRule::Paper => "the photon's energy",
            IntensityRule::Conserving => "the photon's energy / side_px²",
        };
        let coverage = match self.params.caustics.coverage {
            SplatCoverage::Square => {
                "a square of side_px about the hit's place in the buffer; pixels whose centres lie in it, \
                where the hit, moved by depth_bias_m towards the camera, is not behind the camera's depth"
            }
            SplatCoverage::Surface => {
                "a square of side_px about the hit's place in the buffer, in the plane of the surface seen \
                there where that is within depth_bias_m of the hit along the view, else facing the camera; pixels whose centres \
                lie in it, where the plane, moved by depth_bias_m towards the camera, is not behind the camera's depth, and \
                moved by as much away from it not before it"
            }
        };
        json!({
            "size_a_px": splat.size_a_px,
            "size_b_px_m": splat.size_b_px_m,
            "side_px": "size_a_px + size_b_px_m / distance from the camera's position to the hit",
            "value": value,
            "buffer_px": splat.size_px.as_uvec2().to_array(),
            "depth_bias_m": splat.depth_bias_m,
            "coverage": coverage,
        })
    }

    fn line(&self) -> Value {
        let lines = &self.plan.lines;
        let divided = match self.params.godrays.intensity {
            IntensityRule::Paper => "",
            IntensityRule::Conserving => " / width_px",
        };
        json!({
            "width_px": lines.width_px,
            "width": "in pixels of a buffer of square_px, in which pixels are squares of the same area",
            "square_px": lines.square_px.to_array(),
            "phase_k": lines.phase_k,
            "buffer_px": lines.size_px.as_uvec2().to_array(),
            "value": format!("flux_w * weight * phase * exp(-attenuation_per_m * (distance from the point to the camera, of a \
                camera above y = 0 the part of it below, + from the entry to the point)){divided}; phase = (1 - k²) / \
                (4π (1 - k cos)²), cos between the direction and that to the camera"),
        })
    }

    fn irradiance(&self) -> Value {
        let scale = self.plan.compose.caustics_scale;
        match self.params.caustics.intensity {
            IntensityRule::Paper => json!({
                "scale": scale,
                "unit": "1/m²",
                "meaning": "irradiance, W/m², is the texel times the scale: 1 / the area across the view that a splat covers at the \
                    distance of the camera's target; right for what faces the camera there, and nowhere else",
            }),
            IntensityRule::Conserving => json!({
                "scale": scale,
                "unit": "1, side at 1 m from the camera of a square with a pixel's area, m/m",
                "meaning": "irradiance, W/m², is the texel * max(cos, 0.1) * d / (scale² * z³): d from the camera to the surface, z along \
                    the view, cos between its normal and the direction to the camera",
            }),
        }
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
            "meaning": "in the light's space: distances along its axis, and the near plane's rectangle; a directional light's \
                frustum is a box, a point light's a pyramid from its position",
        },
        "emitted_w": frame.emitted_w,
        "meaning": "matrices by rows, metres; photon i starts at photon_grid * (x, y, 0, 1) of its place (x, y) in the grid, -1 to 1; \
            grid_area is the grid's area in m² of a directional light, on the plane at unit distance of a point light",
    })
}

fn rows(matrix: DMat4) -> [[f64; 4]; 4] {
    matrix.transpose().to_cols_array_2d()
}
