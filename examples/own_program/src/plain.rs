//! A program with two compute passes and a render pass: ripples on water, blurred and drawn.
//!
//! `own_program [TAPS]`

mod passes;

use std::error::Error;

use passes::Passes;

const FRAMES: u32 = 60;

fn main() -> Result<(), Box<dyn Error>> {
    let taps = std::env::args().nth(1).map_or(Ok(16), |taps| taps.parse())?;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
    let required_features = wgpu::Features::empty();
    let descriptor = wgpu::DeviceDescriptor { required_features, ..Default::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))?;
    let passes = Passes::new(&device, &queue, taps);

    for _ in 0..FRAMES {
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            passes.ripple(&mut pass);
        }
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            passes.blur(&mut pass);
        }
        {
            let color_attachments = [Some(passes.target())];
            let target = wgpu::RenderPassDescriptor {
                color_attachments: &color_attachments,
                ..Default::default()
            };
            let mut pass = encoder.begin_render_pass(&target);
            passes.shade(&mut pass);
        }
        queue.submit([encoder.finish()]);
    }
    device.poll(wgpu::PollType::wait_indefinitely())?;
    Ok(())
}
