//! Frames on the adapter at hand: what is run and what is sampled, whatever it takes.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use super::sampled::VISIT_PAIRS;
use super::*;
use crate::{ClockPlan, SubmitCost};
use fathom_record::{Clock, Outcome};

const BYTES: u64 = 16;

/// All passes are alone in a submission: those here do too little for timestamps.
fn fenced() -> FrameClock {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default())).unwrap();
    let (device, queue) = pollster::block_on(adapter.request_device(&Default::default())).unwrap();
    let gpu = Device::new(&adapter, device, queue);
    let plan = ClockPlan::fenced(SubmitCost::default());
    FrameClock::audited(gpu, |_| Ok(Audit { rows: Vec::new(), plan })).unwrap()
}

fn buffer(clock: &FrameClock, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    clock.gpu.buffer("test", BYTES, usage | wgpu::BufferUsages::COPY_DST)
}

fn encoder(clock: &FrameClock) -> wgpu::CommandEncoder {
    clock.gpu.device.create_command_encoder(&Default::default())
}

#[test]
fn commands_run_in_their_order_and_each_name_is_sampled_once() {
    use wgpu::BufferUsages as Usage;
    let mut clock = fenced();
    let [from, to] = [Usage::COPY_SRC, Usage::COPY_SRC].map(|usage| buffer(&clock, usage));
    let read_back = buffer(&clock, Usage::MAP_READ);
    for number in 0..2 * VISIT_PAIRS as u32 + 2 {
        let bytes = [number as u8 + 1; BYTES as usize];
        clock.gpu.queue.write_buffer(&from, 0, &bytes);
        let mut encoder = encoder(&clock);
        let mut frame = clock.frame();
        encoder.clear_buffer(&to, 0, None);
        drop(frame.compute_pass(&mut encoder, "guarded", &Default::default()));
        encoder.copy_buffer_to_buffer(&from, 0, &to, 0, BYTES);
        let timestamp_writes = frame.compute(&mut encoder, "own");
        let descriptor = wgpu::ComputePassDescriptor { label: None, timestamp_writes };
        drop(encoder.begin_compute_pass(&descriptor));
        drop(frame.compute_pass(&mut encoder, "guarded", &Default::default()));
        frame.copies(&mut encoder, "copies", |encoder| {
            encoder.copy_buffer_to_buffer(&to, 0, &read_back, 0, BYTES);
        });
        encoder.clear_buffer(&from, 0, None);
        frame.submit(encoder).unwrap();
        let read = clock.gpu.map(&read_back, BYTES, <[u8]>::to_vec).unwrap();
        assert_eq!(read, bytes, "frame {number}");
    }
    let cell = clock.end_cell("test", "size=1,kind=small").unwrap();
    assert_eq!(cell.axes["kind"], "small");
    let Outcome::Measured(measured) = &cell.outcome else { panic!("{cell:?}") };
    let frame = &measured.frame;
    assert!(frame.accounting_error < 1e-6, "one clock read all of it: {frame:?}");
    let stages = measured.stages.iter().map(|stage| (stage.stage.as_str(), stage.clock));
    let names = ["guarded", "own", "copies"];
    assert!(stages.eq(names.map(|name| (name, Clock::FencedHost))));
    let pairs = frame.untimed_samples_ns.len();
    assert!(pairs > 0 && measured.stages.iter().all(|stage| stage.samples_ns.len() == pairs));
    let folder = tempfile::tempdir().unwrap();
    clock.write(folder.path()).unwrap();
    assert!(matches!(clock.write(folder.path()), Err(ClockError::Occupied { .. })));
    assert!(matches!(clock.end_cell("No id", "base"), Err(ClockError::Name(_))));
}

#[test]
fn a_refused_command_is_an_error_of_its_frame_and_no_other() {
    let mut clock = fenced();
    let small = buffer(&clock, wgpu::BufferUsages::COPY_SRC);
    for beyond in [true, false, true, false] {
        let mut encoder = encoder(&clock);
        let mut frame = clock.frame();
        frame.copies(&mut encoder, "clear", |encoder| {
            encoder.clear_buffer(&small, if beyond { 2 * BYTES } else { 0 }, None);
        });
        let outcome = frame.submit(encoder);
        let refused = matches!(&outcome, Err(ClockError::Device(DeviceError::Validation(_))));
        assert_eq!(refused, beyond, "{outcome:?}");
    }
    assert_eq!(clock.sampled.samples.pairs(), 0, "both frames that ran were warm-up");
}

/// Submits a copy of all of a buffer to one that is mapped then. The flag tells whether the device was found to be done.
fn submit_copy(gpu: &Submitter, to: &wgpu::Buffer) -> Arc<AtomicBool> {
    let done = Arc::new(AtomicBool::new(false));
    let flag = done.clone();
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(&gpu.from, 0, to, 0, to.size());
    encoder.map_buffer_on_submit(to, wgpu::MapMode::Read, .., move |_| flag.store(true, Relaxed));
    gpu.queue.submit([encoder.finish()]);
    done
}

/// A library that has the program's device and queue.
struct Submitter {
    device: wgpu::Device,
    queue: wgpu::Queue,
    from: wgpu::Buffer,
}

fn submitter(clock: &FrameClock, size: u64) -> (Submitter, [wgpu::Buffer; 2]) {
    use wgpu::BufferUsages as Usage;
    let gpu = &clock.gpu;
    let from = gpu.buffer("from", size, Usage::COPY_SRC | Usage::COPY_DST);
    let to = [0; 2].map(|_| gpu.buffer("to", size, Usage::MAP_READ | Usage::COPY_DST));
    (Submitter { device: gpu.device.clone(), queue: gpu.queue.clone(), from }, to)
}

#[test]
fn a_submission_has_the_device_to_itself_and_comes_before_the_frames_encoder() {
    let mut clock = fenced();
    let (library, [earlier, own]) = submitter(&clock, 4 << 20);
    for number in 0..2 * VISIT_PAIRS as u8 + 2 {
        library.queue.write_buffer(&library.from, 0, &[number + 1; BYTES as usize]);
        let mut encoder = encoder(&clock);
        let mut frame = clock.frame();
        frame.copies(&mut encoder, "clear", |encoder| encoder.clear_buffer(&library.from, 0, None));
        let before = submit_copy(&library, &earlier);
        let within = frame.submission("library", || {
            assert!(before.load(Relaxed), "the work before is done");
            submit_copy(&library, &own)
        });
        assert!(within.unwrap().load(Relaxed), "its own work is done");
        frame.submit(encoder).unwrap();
        assert_eq!(
            own.get_mapped_range(..).unwrap()[..BYTES as usize],
            [number + 1; BYTES as usize]
        );
        earlier.unmap();
        own.unmap();
    }
    let cell = clock.end_cell("test", "base").unwrap();
    let Outcome::Measured(measured) = &cell.outcome else { panic!("{cell:?}") };
    let stages = measured.stages.iter().map(|stage| (stage.stage.as_str(), stage.clock));
    assert!(stages.eq(["clear", "library"].map(|name| (name, Clock::FencedHost))));
    let fenced = measured.stages.iter().map(|stage| stage.fenced.as_ref().unwrap());
    assert!(fenced.flat_map(|fenced| &fenced.submit_cost_samples_ns).all(|ns| *ns > 0.0));
    assert!(measured.frame.accounting_error < 1e-6, "{:?}", measured.frame);
    assert!(clock.to_string().contains("\n  library  "), "{clock}");
}

#[test]
fn a_frame_whose_submission_was_refused_is_not_sampled_and_one_without_work_is() {
    let mut clock = fenced();
    let (library, [small, _]) = submitter(&clock, BYTES);
    for number in 0..2 * VISIT_PAIRS + 4 {
        let refused = [0, 2].contains(&number);
        let mut frame = clock.frame();
        let ran = frame.submission("library", || {
            let mut encoder = library.device.create_command_encoder(&Default::default());
            encoder.clear_buffer(&small, if refused { 2 * BYTES } else { 0 }, None);
            drop(encoder.finish());
        });
        let error = matches!(&ran, Err(ClockError::Device(DeviceError::Validation(_))));
        assert_eq!(error, refused, "{ran:?}");
        let empty = library.device.create_command_encoder(&Default::default());
        assert_eq!(frame.submit(empty).is_err(), refused);
    }
    let samples = &clock.sampled.samples;
    assert!(samples.pairs() > 0 && samples.rejected_frames().is_empty(), "{samples:?}");
}
