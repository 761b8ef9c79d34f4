//! Memory and time of a pipeline, foreseen before anything is allocated.

use fathom::gpu::Capacity;
use fathom::harness::subject::{Subject, Subjects};

use super::gpu;
use crate::common::sets;

const GIB: u64 = 1 << 30;

/// Of a pipeline, a scene, and what is set.
fn subject(subjects: &mut Subjects, (pipeline, scene, set): (&str, &str, &str)) -> Subject {
    subjects.subject(pipeline, scene, &sets(set)).unwrap()
}

/// A software adapter with every limit, 4 GiB and two cores.
fn small_machine() -> Capacity {
    Capacity {
        limits: wgpu::Limits {
            max_texture_dimension_2d: 16_384,
            max_texture_dimension_3d: 16_384,
            ..wgpu::Limits::unlimited()
        },
        memory_bytes: Some(4 * GIB),
        frame_s: Some(30.0),
        threads: 2,
        ..Capacity::default()
    }
}

/// Planning counts what is allocated: the same code does both.
#[test]
fn demands_foresee_what_pipelines_allocate() {
    let gpu = gpu();
    let mut subjects = Subjects::default().with_capacity(&gpu.capacity);
    let filters = "caustics.filter=true godrays.filter=true caustics.grid=512";
    let direct = "scalar.mode=direct scalar.pyramid=true volume.cells=[48,48,48]";
    let cases = [
        ("underwater", "plane", ""),
        ("underwater", "plane", filters),
        ("hsao", "corner", "hsao.scale=0.5"),
        ("gtao", "corner", "gtao.scale=0.5 gtao.window=square"),
        ("volume_ao", "corner", "ao.skipping=true voxel.resolution=192"),
        ("volume_ao", "corner", "ao.filter=false ao.scale=0.5"),
        ("voxelize", "corner", "voxel.method=slicemap voxel.resolution=256"),
        ("voxelize", "corner", "voxel.method=slice voxel.resolution=128"),
        ("voxelize", "corner", "voxel.method=overlap voxel.resolution=128"),
        ("voxelize", "corner", "voxel.method=max_alpha pyramid=true voxel.resolution=128"),
        ("scalar_ao", "smoke", "scalar.mode=isosurface volume.cells=[64,64,32]"),
        ("scalar_ao", "smoke", direct),
    ];
    for case in cases {
        let subject = subject(&mut subjects, case);
        let foreseen = subject.plan().unwrap().demand.allocated_bytes();
        let allocated = subject.build(&gpu).unwrap().allocated_bytes();
        assert_eq!(foreseen, allocated, "{case:?}");
    }
}

const LARGE: &str = "view.width=16384 view.height=16384";
const OF_VIEW: &str = "view.width × view.height: asks";
const ALLOWED: &str = "or give --allow-large";
const TOO_LONG: &str = "a frame would take about";
const MEDIA: &str = "view.width=4096 view.height=4096 scalar.mode=direct volume.cells=[48,48,48]";
/// A scene that would take minutes and gigabytes to make.
const CELLS: &str = "volume.cells: asks 134217728 of max_texture_dimension_3d";

/// Memory, time and limits; how the reason begins, and what it holds.
#[test]
fn what_the_machine_cannot_take_is_refused_with_the_numbers() {
    let capacity = small_machine();
    let mut subjects = Subjects::default().with_capacity(&capacity);
    for (case, begins, holds) in [
        (("underwater", "plane", LARGE), OF_VIEW, ALLOWED),
        (("hsao", "corner", LARGE), OF_VIEW, ALLOWED),
        (("voxelize", "corner", LARGE), OF_VIEW, ALLOWED),
        (("volume_ao", "corner", LARGE), OF_VIEW, ALLOWED),
        (("volume_ao", "corner", "ao.rays=5000"), "", TOO_LONG),
        (("hsao", "corner", "view.width=4096 view.height=4096"), "", TOO_LONG),
        (("scalar_ao", "smoke", MEDIA), "", TOO_LONG),
        (("scalar_ao", "smoke", "volume.cells=[134217728,1,1]"), CELLS, ""),
    ] {
        let large = subject(&mut subjects, case);
        let made = large.scene.volume.as_ref().map_or(0, |volume| volume.data.len());
        assert!(made <= 48 * 48 * 48, "{case:?}");
        let reason =
            large.limits_exceeded(&capacity).unwrap().unwrap_or_else(|| panic!("{case:?}"));
        let is_told = reason.starts_with(begins) && reason.contains(holds);
        assert!(is_told && !reason.contains('\n'), "{reason}");
        if holds == TOO_LONG {
            let limits_alone = Capacity::from(capacity.limits.clone());
            assert_eq!(large.limits_exceeded(&limits_alone).unwrap(), None);
        }
        if holds == ALLOWED {
            let plain = subject(&mut subjects, (case.0, case.1, ""));
            assert_eq!(plain.limits_exceeded(&capacity).unwrap(), None);
        }
    }
}

#[cfg(feature = "nightly")]
#[test]
fn the_default_suite_fits_a_machine_of_two_cores_and_4_gib() {
    use fathom::Catalog;
    use fathom::harness::plan::{Request, plan};
    use fathom::record::Profile;

    let request = Request::default();
    let experiments = request.load(&Catalog::builtin()).unwrap();
    let (capacity, catalog) = (small_machine(), Catalog::builtin());
    let planned =
        plan(experiments, &request, Profile::Quick, &capacity, &catalog, &|| Ok(())).unwrap();
    let cells = planned.iter().flat_map(|experiment| &experiment.cells);
    let skipped: Vec<_> = cells
        .filter_map(|cell| Some((&cell.plan.experiment, &cell.plan.cell, cell.skip.as_ref()?)))
        .collect();
    assert!(skipped.is_empty(), "{skipped:?}");
}
