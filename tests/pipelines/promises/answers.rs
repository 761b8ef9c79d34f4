//! Answers of references that are kept for later cells, and frames that end with the stage that is read.

use std::rc::Rc;

use fathom::Catalog;
use fathom::gpu::{ClockPlan, FrameTimer, SubmitCost};
use fathom::harness::difference::{image, run_to};
use fathom::harness::subject::Subjects;
use fathom::pipelines::{Judge, ReferenceCache};

use crate::common::sets;
use crate::gpu;

/// A pipeline, a scene, settings that make it small, and changes of what its reference depends on.
const JUDGED: [(&str, &str, &str, &[&str]); 5] = [
    (
        "underwater",
        "plane",
        "view.width=40 view.height=30 caustics.buffer=[32,32] caustics.grid=20 godrays.grid=10 shadow.size=128",
        &[
            "camera.fov_y_deg=30",
            "light.direction=[0.1,-1,0.2]",
            "water.amplitude_m=0.02",
            "water.refractive_index=1.2",
            "water.attenuation_per_m=0.5",
            "floor_depth_m=3",
            "view.width=60",
            "caustics.grid=30",
            "caustics.offset=[0.3,0.8]",
            "caustics.subdivision=9",
            "godrays.jitter=0.1",
        ],
    ),
    (
        "photon_tracing",
        "plane",
        "view.width=40 view.height=30 transfer.grid=[24,24] shadow.size=128",
        &[
            "camera.fov_y_deg=30",
            "light.direction=[0.1,-1,0.2]",
            "water.amplitude_m=0.02",
            "water.refractive_index=1.2",
            "transfer.grid=[30,24]",
            "transfer.offset=[0.3,0.8]",
            "specular.follow=true",
        ],
    ),
    (
        "shadow_rays",
        "ball",
        "view.width=40 view.height=30",
        &["camera.fov_y_deg=30", "light.direction=[0.1,-1,0.2]", "view.width=60"],
    ),
    (
        "refraction",
        "slab",
        "view.width=40 view.height=30",
        &["camera.fov_y_deg=30", "refraction.count=3", "view.width=60"],
    ),
    (
        "hsao",
        "ball",
        "view.width=40 view.height=30 shadow.size=128",
        &["camera.fov_y_deg=30", "hsao.r_max_m=0.3", "animation.deform=wave", "view.width=60"],
    ),
];

#[test]
fn a_kept_answer_is_that_of_its_own_question() {
    let gpu = gpu();
    let mut subjects = Subjects::new(&Catalog::builtin()).silent();
    for (pipeline, scene, small, changes) in JUDGED {
        let mut kept = ReferenceCache::default();
        // Each change from the settings before, and once more where every answer is known.
        let changed = std::iter::once(&"").chain(changes).copied();
        for change in changed.clone().chain(changed) {
            let settings = sets(&format!("{small} {change}"));
            let subject = subjects.subject(pipeline, scene, &settings).unwrap();
            let frame = subject.build(&gpu).unwrap();
            gpu.run(&frame.stages()).unwrap();
            let requested = ["caustics_image_error".to_owned()];
            let judged = |references: &mut ReferenceCache| {
                let scene: &Rc<_> = &subject.scene;
                let mut judge = Judge { gpu: &gpu, scene, references, requested: &requested };
                let judged = frame.judge(&mut judge).unwrap();
                assert!(!judged.errors.is_empty(), "{pipeline}");
                format!("{:?} {:?}", judged.errors, judged.quantities)
            };
            let fresh = judged(&mut ReferenceCache::default());
            assert_eq!(judged(&mut kept), fresh, "{pipeline} {change}");
        }
    }
}

/// Lists of stages whose first present output is read, as experiments name them.
const READ: [(&str, &[&[&str]]); 4] = [
    ("underwater", &[&["caustics/filter", "caustics/splat"], &["godrays/filter", "godrays/lines"]]),
    ("underwater", &[&["godrays/none", "caustics/splat"]]),
    ("photon_tracing", &[&["sprites/draw"]]),
    ("hsao", &[&["hsao/filter", "hsao/march"]]),
];

#[test]
fn a_frame_that_ends_with_the_stage_that_is_read_leaves_what_a_whole_frame_leaves() {
    let gpu = gpu();
    let mut timer = FrameTimer::new(&gpu, ClockPlan::fenced(SubmitCost::default()), 0).unwrap();
    let mut subjects = Subjects::new(&Catalog::builtin()).silent();
    for (pipeline, outputs) in READ {
        let (_, scene, small, _) = JUDGED.into_iter().find(|row| row.0 == pipeline).unwrap();
        let subject = subjects.subject(pipeline, scene, &sets(small)).unwrap();
        let owned = |names: &&[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let names: Vec<Vec<String>> = outputs.iter().map(owned).collect();
        let read: Vec<&[String]> = names.iter().map(Vec::as_slice).collect();
        let [whole, part] = [(); 2].map(|()| subject.build(&gpu).unwrap());
        gpu.run(&whole.stages()).unwrap();
        run_to(&gpu, &mut timer, &part, &read).unwrap();
        for stages in read {
            let [whole, part] = [&whole, &part].map(|frame| image(&gpu, frame, stages).unwrap());
            assert!(whole.data.iter().any(|value| *value != 0.0), "{stages:?} is black");
            assert_eq!(whole, part, "{pipeline} {stages:?}");
        }
    }
}
