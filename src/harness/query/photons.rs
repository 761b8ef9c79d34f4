//! `fathom query photons`: where photons from given starts enter the water and land.

use std::io::{Read, Write};
use std::path::Path;

use anyhow::{Result, anyhow, ensure};
use glam::{DVec3, Vec3};
use itertools::Itertools;
use rayon::prelude::*;

use super::table::{self, SHORT};
use super::{check, numbers, read_with, written};
use crate::subject::Subject;
use fathom_gpu::Gpu;
use fathom_pipelines::underwater::{self, Intensity, Params, Underwater, photon_query, photons_at};
use fathom_reference::photons::{Landing, entering, land_ray};
use fathom_reference::rays::Tracer;
use fathom_scene::{LightFrame, LightKind};
use fathom_stages::kit::Resources;
use fathom_stages::photon::{MISSED, OUTSIDE};
use fathom_stages::photons::query::{self, Answer};
use fathom_stages::uniforms::View;

/// Columns that a file of starts must have, and those that it may have.
const PLACE: [&str; 3] = ["x", "y", "z"];
const DIRECTION: [&str; 3] = ["dx", "dy", "dz"];
/// Directions must fall at least so much, at unit length: shallower rays may run past the water.
const LEAST_FALL: f64 = 0.01;

const ANSWER: [&str; 14] = [
    "outcome",
    "entry_x",
    "entry_y",
    "entry_z",
    "direction_x",
    "direction_y",
    "direction_z",
    "hit_x",
    "hit_y",
    "hit_z",
    "distance_m",
    "weight",
    "residual_m",
    "converged",
];
/// Columns of the reference: those of the answer up to the weight, and the distance between the two hits.
const REFERENCE_COLUMNS: usize = 12;
const ERROR: &str = "error_m";

/// Where a photon starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    pub position_m: DVec3,
    /// Of unit length; the light's own ray runs through the start where there is none.
    pub direction: Option<DVec3>,
}

/// The starts of a CSV file with the columns x, y, z (metres) and, all or none, dx, dy, dz; others are left aside. An error names
/// the first fault, its line and column.
pub fn read(path: &Path) -> Result<Vec<Start>> {
    read_with(path, parse)
}

fn parse(text: impl Read) -> Result<Vec<Start>> {
    let (rows, aimed) = table::read(text, &PLACE, &DIRECTION)?;
    rows.into_iter().map(|row| start(row, aimed)).collect()
}

fn start((line, numbers): table::TableRow, aimed: bool) -> Result<Start> {
    let position_m = DVec3::from_slice(&numbers);
    let y = position_m.y;
    ensure!(
        y > 0.0,
        "line {line}, columns `x`, `y`, `z`: a start at y = {y} is not above the water"
    );
    if !aimed {
        return Ok(Start { position_m, direction: None });
    }
    let given = DVec3::from_slice(&numbers[3..]);
    let direction = given / given.length();
    ensure!(
        given.length() >= SHORT && direction.y <= -LEAST_FALL,
        "line {line}, columns `dx`, `dy`, `dz`: the direction {:?} must point downwards: its y, at unit length, must be below \
         -{LEAST_FALL}",
        given.to_array()
    );
    Ok(Start { position_m, direction: Some(direction) })
}

/// What is asked of a subject of the pipeline `underwater`.
pub struct Query {
    starts: Vec<Start>,
    params: Params,
    view: View,
    light: LightFrame,
}

impl Query {
    pub fn new(subject: &Subject, starts: Vec<Start>) -> Result<Query> {
        let params = subject.parameters::<Underwater>()?;
        let view = underwater::view(&params, &subject.scene);
        let light = view.light_frame();
        let query = Query { starts, params, view, light };
        match query.starts.iter().position(|s| query.incident(s).y > -LEAST_FALL) {
            None => Ok(query),
            Some(i) => Err(anyhow!(
                "start {}: the light's ray through it does not fall on the water; move it below the light",
                i + 1
            )),
        }
    }

    /// Unit direction in the air.
    fn incident(&self, start: &Start) -> DVec3 {
        start.direction.unwrap_or_else(|| match self.light.kind {
            LightKind::Directional => self.light.forward,
            LightKind::Point => (start.position_m - self.light.position).normalize_or(DVec3::Y),
        })
    }

    /// The answers of the GPU's tracing. What is beyond the adapter's limits is an error before anything is allocated.
    pub fn answers(&self, gpu: &Gpu, subject: &Subject) -> Result<Vec<Answer>> {
        let starts: Vec<query::Start> = self.starts.iter().map(stored).collect();
        let plan = |resources: &Resources<'_>| {
            photon_query(resources, &subject.scene, &self.params, &starts).map(drop)
        };
        check(gpu, plan)?;
        Ok(gpu.scoped(|| photons_at(gpu, &subject.scene, &self.params, &starts))?)
    }

    /// Exact refraction and ray casting from the same starts.
    pub fn reference(&self, subject: &Subject) -> Vec<Landing> {
        let tracer = Tracer::new(&subject.scene.objects);
        let land = |start: &Start| {
            land_ray(&self.view.water, &tracer, start.position_m, self.incident(start))
        };
        self.starts.par_iter().map(land).collect()
    }

    /// What enters the water of the energy of the photon that lands so.
    fn exact_weight(&self, start: &Start, landing: &Landing) -> f64 {
        let entry = match landing {
            Landing::Landed(landed) => &landed.entry,
            Landing::Leaves { entry, .. } => entry,
            Landing::Blocked | Landing::MissesWater => return 0.0,
        };
        let incident = self.incident(start);
        let mut weight = entering(&self.view.water, entry.normal, incident);
        let conserving = self.params.caustics.intensity == Intensity::Conserving;
        if conserving && start.direction.is_none() && self.light.kind == LightKind::Point {
            weight *= incident.dot(self.light.forward).powi(3);
        }
        weight
    }

    /// Writes the starts in their order with their answers, and with the reference's where there are any; `target` names
    /// the writer in errors.
    pub fn write(
        &self,
        target: &str,
        writer: impl Write,
        answers: &[Answer],
        reference: Option<&[Landing]>,
    ) -> Result<()> {
        let row = |(i, (start, answer)): (usize, (&Start, &Answer))| {
            let mut fields = numbers([start.position_m, self.incident(start)]).collect_vec();
            fields.extend(self.answer(answer));
            if let Some(landing) = reference.and_then(|all| all.get(i)) {
                fields.extend(self.exact(start, landing));
                fields.push(error(answer, landing));
            }
            fields
        };
        let rows = self.starts.iter().zip(answers).enumerate().map(row);
        written(target, writer, header(reference.is_some()), rows)
    }

    fn answer(&self, answer: &Answer) -> Vec<String> {
        let photon = &answer.photon;
        let mut fields = vec![outcome(photon.residual_m).to_owned()];
        let entered = photon.residual_m != MISSED;
        let landed = photon.residual_m >= 0.0;
        fields.extend(components(entered.then(|| photon.entry_m.to_array())));
        fields.extend(components(entered.then(|| answer.direction.to_array())));
        fields.extend(components(landed.then(|| photon.hit_m.to_array())));
        fields.push(number(landed.then_some(photon.distance_m)));
        fields.push(answer.weight.to_string());
        fields.push(number(landed.then_some(photon.residual_m)));
        let converged = landed && f64::from(photon.residual_m) <= self.params.caustics.tolerance_m;
        fields.push(u8::from(converged).to_string());
        fields
    }

    fn exact(&self, start: &Start, landing: &Landing) -> Vec<String> {
        let (outcome, entry, direction) = match landing {
            Landing::Landed(landed) => ("landed", Some(&landed.entry), Some(landed.direction)),
            Landing::Leaves { entry, direction } => ("leaves", Some(entry), Some(*direction)),
            Landing::Blocked => ("blocked", None, None),
            Landing::MissesWater => ("misses_water", None, None),
        };
        let landed = landing.landed();
        let mut fields = vec![outcome.to_owned()];
        let hit = landed.map(|landed| landed.hit.position);
        for place in [entry.map(|entry| entry.position), direction, hit] {
            fields.extend(components(place.map(|p| p.to_array())));
        }
        fields.push(number(landed.map(|landed| landed.hit.distance_m)));
        fields.push(self.exact_weight(start, landing).to_string());
        fields
    }
}

/// A start as the shader reads it.
fn stored(start: &Start) -> query::Start {
    query::Start {
        position_m: start.position_m.as_vec3(),
        aimed: u32::from(start.direction.is_some()),
        direction: start.direction.map_or(Vec3::ZERO, |d| d.as_vec3()),
    }
}

fn header(reference: bool) -> Vec<String> {
    let mut names =
        [&PLACE[..], &DIRECTION, &ANSWER].concat().iter().map(ToString::to_string).collect_vec();
    if reference {
        names.extend(ANSWER[..REFERENCE_COLUMNS].iter().map(|name| format!("reference_{name}")));
        names.push(ERROR.to_owned());
    }
    names
}

/// What became of a photon on the GPU.
fn outcome(residual_m: f32) -> &'static str {
    if residual_m == MISSED {
        "misses_water"
    } else if residual_m == OUTSIDE {
        "lost"
    } else {
        "landed"
    }
}

fn number<T: ToString>(value: Option<T>) -> String {
    value.map_or_else(String::new, |value| value.to_string())
}

fn components<T: ToString>(vector: Option<[T; 3]>) -> [String; 3] {
    vector.map_or_else(Default::default, |vector| vector.map(|component| component.to_string()))
}

/// Distance between the two hits, where both landed.
fn error(answer: &Answer, landing: &Landing) -> String {
    let landed = landing.landed().filter(|_| answer.photon.residual_m >= 0.0);
    number(landed.map(|l| answer.photon.hit_m.as_dvec3().distance(l.hit.position)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_may_have_directions_all_or_none() {
        let plain = parse("z,x,y,name\n3,1,2,a\n".as_bytes()).unwrap();
        let place = DVec3::new(1.0, 2.0, 3.0);
        assert_eq!(plain, [Start { position_m: place, direction: None }]);
        let aimed = parse("x,y,z,dx,dy,dz\n1,2,3,0,-4,0\n".as_bytes()).unwrap();
        assert_eq!(aimed[0].direction, Some(DVec3::NEG_Y));
        let fault = |text: &str| parse(text.as_bytes()).unwrap_err().to_string();
        assert!(fault("x,y,z,dx,dy\n").contains("no column `dz`: x, y, z, dx, dy and dz"));
        assert!(fault("x,y\n").contains("no column `z`: x, y and z are needed"));
        let below = fault("x,y,z\n1,-2,3\n");
        assert!(below.starts_with("line 2, columns `x`, `y`, `z`: a start at y = -2"), "{below}");
        for direction in ["0,1,0", "1,0,0", "0,0,0"] {
            let fault = fault(&format!("x,y,z,dx,dy,dz\n1,2,3,{direction}\n"));
            assert!(fault.contains("must point downwards"), "{fault}");
        }
    }

    #[test]
    fn answers_have_a_field_for_each_column() {
        assert_eq!(header(false).len(), 20);
        assert_eq!(header(true).len(), 33);
        assert_eq!(header(true)[20], "reference_outcome");
        assert_eq!(ANSWER[REFERENCE_COLUMNS - 1], "weight");
    }
}
