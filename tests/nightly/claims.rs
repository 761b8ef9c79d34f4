//! A claim of a figure or an error that is supported can fail: the fault that its file names turns it.

use std::collections::HashSet;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use fathom::embedded::{Folder, Folders, SHADERS};
use fathom::experiments::{Experiment, Fault, Verdict, flatten};
use fathom::harness::plan::Request;
use fathom::harness::run::{RunOptions, run};
use fathom::record::{Cell, Profile};

use crate::common::{Place, cells};

/// Claims whose faults are tried, at least.
const MIN_TRIED: usize = 40;

/// Verdicts on the claims of an experiment by the cells that a fault names, in its order.
fn verdicts(experiment: &Experiment, fault: &Fault, is_put_in: bool) -> Vec<Verdict> {
    let place = Place::new();
    let given = Some(experiment.clone());
    let mut options = RunOptions {
        request: Request { given, cells: fault.cells.clone(), ..Request::default() },
        profile: Some(Profile::Quick),
        visits: Some(1),
        // No machine is so slow: a visit to each cell ends the run.
        budget_s: Some(86_400.0),
        out: Some(place.path("out")),
        no_ceilings: true,
        ..RunOptions::default()
    };
    if is_put_in {
        options.request.sets = flatten(&fault.set);
        if !fault.shader.is_empty() {
            let [from, to] = &fault.line;
            let file = format!("{}.wgsl", fault.shader);
            let text = SHADERS.text(&file).unwrap_or_else(|| panic!("{file}"));
            assert_eq!(text.matches(from.as_str()).count(), 1, "{file}: `{from}`");
            place.write(format!("shaders/{file}"), text.replace(from, to));
            let folder = Folder::from_path(place.path("shaders"));
            options.gpu.shaders = Some(Folders::new(folder).with(SHADERS));
        }
    }
    let summary = run(&options, Instant::now(), Arc::new(|_, _, _| ()), &AtomicBool::new(false));
    let counts = summary.unwrap().counts;
    assert_eq!(counts.measured, fault.cells.len(), "{}: {counts:?}", experiment.id);
    let cells = cells(&place.path("out"));
    let rulings = experiment.rulings(&cells.iter().collect::<Vec<&Cell>>(), true);
    rulings.into_iter().map(|ruling| ruling.verdict).collect()
}

#[test]
fn a_fault_turns_each_supported_claim_of_a_figure() {
    let (mut tried, mut left) = (HashSet::new(), Vec::new());
    for id in Experiment::builtin_ids() {
        let experiment = Experiment::load(&id).unwrap();
        let mut faults: Vec<&Fault> =
            experiment.claim.iter().map(|claim| &claim.broken_by).collect();
        faults.retain(|fault| fault.is_tried());
        faults.dedup();
        for fault in faults {
            let [whole, broken] = [false, true].map(|put_in| verdicts(&experiment, fault, put_in));
            let of_fault = experiment.claim.iter().zip(whole.iter().zip(&broken));
            let of_fault = of_fault.filter(|(claim, _)| claim.broken_by == *fault);
            let supported: Vec<_> =
                of_fault.filter(|(_, (whole, _))| **whole == Verdict::Supported).collect();
            for (claim, (_, broken)) in &supported {
                let turned = matches!(broken, Verdict::Contradicted | Verdict::NearBound);
                left.extend((!turned).then(|| format!("{id} {}: {broken}", claim.id)));
                tried.insert(format!("{id} {}", claim.id));
            }
            if supported.is_empty() {
                left.push(format!(
                    "{id} `{}`: supports no claim without it: {whole:?}",
                    fault.what
                ));
            }
        }
    }
    assert!(left.is_empty(), "{left:#?}");
    assert!(tried.len() >= MIN_TRIED, "{} claims: {tried:?}", tried.len());
}
