//! Answers of references that are kept for later cells, and frames that end with the stage that is read.

use fathom::Catalog;
use fathom::gpu::{ClockPlan, FrameTimer, SubmitCost};
use fathom::harness::difference::{image, run_to};
use fathom::harness::subject::Subjects;
use fathom::pipelines::{Judge, ReferenceCache};

use crate::common::sets;
use crate::gpu;

/// A pipeline that is made small, changes of what its references depend on, and stages whose output is read.
const CASES: [(&str, &str, &str, &[&[&str]]); 3] = [
    (
        "underwater plane",
        "view.width=40 view.height=30 caustics.buffer=[32,32] caustics.grid=20 godrays.grid=10 shadow.size=128",
        "view.width=60 camera.fov_y_deg=30 light.direction=[0.1,-1,0.2] water.amplitude_m=0.02 water.refractive_index=1.2 floor_depth_m=3 caustics.grid=30 caustics.offset=[0.3,0.8] caustics.subdivision=9 godrays.jitter=0.1",
        &[&["caustics/filter", "caustics/splat"], &["none", "godrays/lines"]],
    ),
    (
        "hsao ball",
        "view.width=40 view.height=30 shadow.size=128",
        "view.width=60 camera.fov_y_deg=30 hsao.r_max_m=0.3 animation.deform=wave",
        &[&["hsao/march"]],
    ),
    ("photon_tracing plane", "view.width=40 view.height=30", "", &[&["sprites/draw"]]),
];

/// The settings as they are, each change by itself, and all once more where every answer is known.
#[test]
fn a_kept_answer_is_that_of_its_own_question() {
    let (gpu, mut subjects) = (gpu(), Subjects::new(&Catalog::builtin()).silent());
    for (of, small, changes, _) in CASES {
        let (pipeline, scene) = of.split_once(' ').unwrap();
        let (kept, mut answers) = (ReferenceCache::default(), std::collections::BTreeMap::new());
        let changes: Vec<&str> = std::iter::once("").chain(changes.split_whitespace()).collect();
        for change in changes.iter().chain(&changes) {
            let settings = sets(&format!("{small} {change}"));
            let subject = subjects.subject(pipeline, scene, &settings).unwrap();
            let (frame, scene) = (subject.build(&gpu).unwrap(), &subject.scene);
            gpu.run(&frame.stages()).unwrap();
            let judged = |references: &ReferenceCache| {
                let judge = frame.judge(&gpu, &[]).unwrap();
                let judged = judge(&Judge::new(scene, references)).unwrap();
                format!("{:?} {:?}", judged.errors, judged.quantities)
            };
            let fresh = answers.entry(change).or_insert_with(|| judged(&Default::default()));
            assert_eq!(judged(&kept), *fresh, "{of} {change}");
        }
    }
}

#[test]
fn a_frame_that_ends_with_the_stage_that_is_read_leaves_what_a_whole_frame_leaves() {
    let (gpu, mut subjects) = (gpu(), Subjects::new(&Catalog::builtin()).silent());
    let mut timer = FrameTimer::new(&gpu, ClockPlan::fenced(SubmitCost::default()), 0).unwrap();
    for (of, small, _, outputs) in CASES {
        let (pipeline, scene) = of.split_once(' ').unwrap();
        let subject = subjects.subject(pipeline, scene, &sets(small)).unwrap();
        let [whole, part] = [(); 2].map(|()| subject.build(&gpu).unwrap());
        let owned = |names: &&[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let outputs: Vec<Vec<String>> = outputs.iter().map(owned).collect();
        let read: Vec<&[String]> = outputs.iter().map(Vec::as_slice).collect();
        gpu.run(&whole.stages()).unwrap();
        run_to(&gpu, &mut timer, &part, &read).unwrap();
        for stages in read {
            let [whole, part] = [&whole, &part].map(|frame| image(&gpu, frame, stages).unwrap());
            assert!(whole.data.iter().any(|value| *value != 0.0), "{stages:?} is black");
            assert_eq!(whole, part, "{of} {stages:?}");
        }
    }
}
