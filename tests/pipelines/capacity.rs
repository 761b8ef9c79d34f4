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

#[test]
fn a_view_beyond_the_memory_is_refused_with_the_numbers() {
    let capacity = small_machine();
    let mut subjects = Subjects::default().with_capacity(&capacity);
    let corner = ["hsao", "voxelize", "volume_ao"].map(|pipeline| (pipeline, "corner"));
    for (pipeline, scene) in [("underwater", "plane")].into_iter().chain(corner) {
        let large = (pipeline, scene, "view.width=16384 view.height=16384");
        let reason = subject(&mut subjects, large).limits_exceeded(&capacity).unwrap();
        let reason = reason.unwrap_or_else(|| panic!("{pipeline}"));
        assert!(reason.starts_with("view.width × view.height: asks"), "{reason}");
        assert!(reason.ends_with("or give --allow-large") && !reason.contains('\n'), "{reason}");
        let plain = subject(&mut subjects, (pipeline, scene, ""));
        assert_eq!(plain.limits_exceeded(&capacity).unwrap(), None);
    }
}

#[test]
fn a_frame_of_minutes_is_refused_and_allowed_where_nothing_bounds_it() {
    let capacity = small_machine();
    let mut subjects = Subjects::default().with_capacity(&capacity);
    for case in [
        ("volume_ao", "corner", "ao.rays=5000"),
        ("hsao", "corner", "view.width=4096 view.height=4096"),
        (
            "scalar_ao",
            "smoke",
            "view.width=4096 view.height=4096 scalar.mode=direct volume.cells=[48,48,48]",
        ),
    ] {
        let subject = subject(&mut subjects, case);
        let reason =
            subject.limits_exceeded(&capacity).unwrap().unwrap_or_else(|| panic!("{case:?}"));
        assert!(reason.contains("a frame would take about"), "{reason}");
        let limits_alone = Capacity::from(capacity.limits.clone());
        assert_eq!(subject.limits_exceeded(&limits_alone).unwrap(), None);
    }
}

/// The scene would take minutes and gigabytes to make.
#[test]
fn a_volume_beyond_the_limits_is_refused_before_its_scene_is_made() {
    let capacity = small_machine();
    let mut subjects = Subjects::default().with_capacity(&capacity);
    let case = ("scalar_ao", "smoke", "volume.cells=[134217728,1,1]");
    let subject = subject(&mut subjects, case);
    assert!(subject.scene.volume.as_ref().unwrap().data.len() < 1_000);
    let reason = subject.limits_exceeded(&capacity).unwrap().expect("it is beyond the limits");
    let asked = "volume.cells: asks 134217728 of max_texture_dimension_3d";
    assert!(reason.starts_with(asked), "{reason}");
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
        plan(experiments, &request, Profile::Quick, (&capacity, &catalog), &|| Ok(())).unwrap();
    let cells = planned.iter().flat_map(|experiment| &experiment.cells);
    let skipped: Vec<_> = cells
        .filter_map(|cell| Some((&cell.plan.experiment, &cell.plan.cell, cell.skip.as_ref()?)))
        .collect();
    assert!(skipped.is_empty(), "{skipped:?}");
}
