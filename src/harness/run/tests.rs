//! Runs and sweeps into one folder by modelled processes that are killed, between which program, machine, mesh and settings change.

use std::path::Path;
use std::sync::Arc;

use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde_json::json;

use super::*;
use fathom_base::input::digest;
use fathom_clock::{FrameSample, StageTime, frame_record, stage_record};
use fathom_record::Measured;

const OWN: &str = r#"
id = "own"
title = "t"
source = "SOURCE"
pipeline = "voxelize"
scene = "MESH"
params = { view = { width = 8, height = 8 } }
[[sweep]]
[[sweep.axis]]
name = "voxel.resolution"
values = [8, 16, 32]
"#;

/// What samples rest on: numbers of the program, the machine, the mesh and the setting.
type Origin = [u32; 4];

fn mesh(number: u32) -> String {
    "v 0 0 0\nv 1 0 0\nv 0 1 0\n".to_owned() + &"f 1 2 3\n".repeat(1 + number as usize)
}

fn header([program, host, _, setting]: Origin) -> Run {
    let line = format!("fathom run own.toml --set view.height={}", 8 + setting);
    let build = Build { program: Some(program.to_string()), ..Build::default() };
    let conditions = Conditions { host: Some(host.to_string()), ..Conditions::default() };
    let command = line.split(' ').map(str::to_owned).collect();
    Run { schema: SCHEMA, build: Some(build), command, conditions, ..Run::default() }
}

/// A process that goes on with the folder and is killed at some moment, or is refused. Each sample is the number of its origin.
fn process(place: &Path, origin: Origin, text: &str, random: &mut Pcg64) -> Result<()> {
    let out = place.join("out");
    std::fs::write(place.join("own.obj"), mesh(origin[2]))?;
    let experiments = vec![Experiment::parse("own", text)?];
    let sets = vec![("view.height".to_owned(), json!(8 + origin[3]))];
    let request = Request { experiments: vec!["own.toml".into()], sets, ..Request::default() };
    let asked = asked(&request, &experiments);
    let header = Run { experiments: Some(asked.clone()), ..header(origin) };
    let mut held = match out.is_dir() {
        true => Recording::resume(Some(&out))?,
        false => Recording::create(Some(&out), "gpu", Profile::Quick)?,
    };
    check_same_request(&held, &header.command, &asked, &experiments)?;
    let (capacity, catalog) = (wgpu::Limits::default().into(), Catalog::builtin());
    let definition = definition(&experiments[0]);
    let mut planned =
        plan::plan(experiments, &request, Profile::Quick, &capacity, &catalog, &|| Ok(()))?;
    let earlier = record::earlier(&held.before, &header);
    plan::drop_finished(&mut planned, &earlier);
    let mut known = CellProgress::new(&planned[0], &held.before, &earlier);
    held.writer.write_all(&[Record::Run(Box::new(header)), Record::Experiment(definition)])?;
    let mut cells: Vec<_> = planned[0].cells.iter().enumerate().collect();
    cells.shuffle(random);
    let ns = origin.iter().fold(1.0, |number, of| 10.0 * number + f64::from(*of));
    for (index, cell) in cells.into_iter().take(random.random_range(0..4)) {
        let mut samples = known.samples.remove(&index).unwrap_or_default();
        for _ in 0..random.random_range(1..4) {
            let stages = vec![StageTime { ns, ..StageTime::zero("a") }];
            let frame = FrameSample { stages, gaps_ns: 0.0, envelope_ns: ns, faults: Vec::new() };
            samples.add(frame, ns, 0, 0.0, None, None);
        }
        let unfinished = Note::new(NoteKind::Unfinished, "killed");
        let measured = Measured {
            stages: vec![stage_record(&samples, 0, "a")],
            frame: frame_record(&samples),
            notes: random.random_bool(0.5).then_some(unfinished).into_iter().collect(),
            ..Measured::default()
        };
        let record = cell.record(Outcome::Measured(measured.into()));
        held.writer.write(&Record::Cell(record.into()))?;
    }
    Ok(())
}

/// `FATHOM_DRAWS=100` tries 1,000 sequences.
#[test]
fn no_cell_mixes_two_programs_machines_meshes_or_settings() {
    let draws = std::env::var("FATHOM_DRAWS").map_or(3, |text| text.parse().unwrap());
    let (mut continued, mut refused) = (0, 0);
    for seed in 0..10 * draws {
        let (place, mut random) = (tempfile::tempdir().unwrap(), Pcg64::seed_from_u64(seed));
        let path = place.path().join("own.obj").display().to_string();
        let text = OWN.replace("SOURCE", ["none", SOURCE][seed as usize % 2]);
        let (text, mut origin) = (text.replace("MESH", &path), [0; 4]);
        for _ in 0..8 {
            let changes =
                |old| if random.random_bool(0.3) { random.random_range(0..3) } else { old };
            origin = origin.map(changes);
            refused += u32::from(process(place.path(), origin, &text, &mut random).is_err());
        }
        let mut run = &Run::default();
        for record in &Recording::resume(Some(&place.path().join("out"))).unwrap().before {
            match record {
                Record::Run(of) => run = of,
                Record::Cell(cell) => {
                    let own = &cell.measured().unwrap().frame.untimed_samples_ns;
                    let origin = [1000, 100, 10, 1].map(|unit| own[0] as u32 / unit % 10);
                    assert!(own.iter().all(|ns| *ns == own[0]), "seed {seed}: {own:?}");
                    let expected = header(origin);
                    let of_run = (&run.build, &run.conditions, &run.command);
                    let expected = (&expected.build, &expected.conditions, &expected.command);
                    assert_eq!(of_run, expected, "seed {seed}");
                    let mesh = digest(mesh(origin[2]).as_bytes()).unwrap();
                    assert_eq!(cell.sources["own.obj"], mesh, "seed {seed}");
                    continued += u32::from(own.len() > 3);
                }
                _ => {}
            }
        }
    }
    assert!(continued > 0 && refused > 0, "{continued} cells, {refused} runs");
}

const SHADED: &str = r#"
id = "shaded"
title = "t"
source = "none"
pipeline = "volume_ao"
scene = "ball"
pictures = "all"
error_picture = true
params = { view = { width = 48, height = 36 }, voxel.resolution = 16, shadow.size = 64 }
[[sweep]]
axis."ao.rays".values = [4, 8, 16]
"#;

/// Beside a driver that has cores to spare, as a card has.
#[test]
fn records_and_pictures_are_the_same_with_workers_and_without() {
    let with_workers = |workers| {
        let out = tempfile::tempdir().unwrap().path().join("out");
        let given = Some(Experiment::parse("shaded", SHADED).unwrap());
        let options = RunOptions {
            request: Request { given, ..Request::default() },
            budget_s: Some(3600.0),
            visits: Some(1),
            out: Some(out.clone()),
            no_ceilings: true,
            workers: Some(workers),
            ..RunOptions::default()
        };
        let report = Arc::new(|_: &Path, _: &[Record], _| ());
        run(&options, Instant::now(), report, &AtomicBool::new(false)).unwrap();
        let records = record::read(&out.join("records.jsonl")).unwrap().records;
        let cells = records.iter().filter_map(Record::try_as_cell_ref);
        let found = cells.map(|cell| {
            let Measured { errors, quantities, pictures, .. } = cell.measured().unwrap().clone();
            assert!(cell.measured().unwrap().is_finished() && pictures.len() == 2, "{cell:?}");
            let bytes = pictures.iter().map(|of| std::fs::read(out.join(&of.path)).unwrap());
            let bytes: Vec<_> = bytes.collect();
            (cell.cell.clone(), format!("{errors:?} {quantities:?} {pictures:?}"), bytes)
        });
        let mut found: Vec<_> = found.collect();
        found.sort();
        found
    };
    let alone = with_workers(0);
    assert_eq!(alone.len(), 3);
    assert!(alone == with_workers(2));
}
