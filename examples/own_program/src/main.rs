//! A program with two compute passes and a render pass: ripples on water, blurred and drawn.
//!
//! `own_program [TAPS [FOLDER [SECONDS]]]`

mod passes;

use std::error::Error;

use fathom_clock::FrameClock;
use passes::Passes;

fn main() -> Result<(), Box<dyn Error>> {
    let taps = std::env::args().nth(1).map_or(Ok(16), |taps| taps.parse())?;
    let seconds = std::env::args().nth(3).map_or(Ok(90.0), |seconds| seconds.parse())?;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
    let required_features = fathom_clock::features(&adapter);
    let descriptor = wgpu::DeviceDescriptor { required_features, ..Default::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))?;
    let passes = Passes::new(&device, &queue, taps);

    let mut clock = FrameClock::new(&adapter, &device, &queue)?.with_budget(seconds);
    while clock.wants_frame() {
        let mut frame = clock.frame();
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = frame.compute_pass(&mut encoder, "ripple", &Default::default());
            passes.ripple(&mut pass);
        }
        {
            let mut pass = frame.compute_pass(&mut encoder, "blur", &Default::default());
            passes.blur(&mut pass);
        }
        {
            let color_attachments = [Some(passes.target())];
            let target = wgpu::RenderPassDescriptor {
                color_attachments: &color_attachments,
                ..Default::default()
            };
            let mut pass = frame.render_pass(&mut encoder, "shade", &target);
            passes.shade(&mut pass);
        }
        frame.submit(encoder)?;
    }
    device.poll(wgpu::PollType::wait_indefinitely())?;
    clock.end_cell("own-program", "base")?;
    print!("{clock}");
    clock.write(std::env::args().nth(2).unwrap_or("own-program".into()).as_ref())?;
    Ok(())
}
