//! Frames of vello, which records and submits by itself: four scenes of growing numbers of paths.
//!
//! `vello_frames [--work FACTOR] [--plain] [OUT]` times them by [`fathom_clock::Frame::submission`] and writes records. The scene `forest` has
//! FACTOR times its paths. `--plain` also times each frame by a loop without fathom's clock, in turn.
//! `vello_frames [--work FACTOR] [--counted] --worker` is a worker of `fathom compare` (`docs/worker-protocol.md`). `--counted` answers the
//! number of paths in place of a time.

mod worker;

use std::error::Error;

use fathom_clock::record::{Clock, StageRecord};
use fathom_clock::{Device, FrameClock, HostClock};
use vello::kurbo::{Affine, BezPath, Point, Stroke};
use vello::peniko::{Color, Fill};
use vello::{AaConfig, AaSupport, RenderParams, Renderer, RendererOptions, Scene};

/// The scenes and their paths.
const SCENES: [(&str, u32); 4] = [("icon", 20), ("chart", 60), ("map", 180), ("forest", 540)];
/// The one that `--work` changes.
const CHANGED: &str = "forest";
/// Pixels along an edge of the picture.
const EDGE: u32 = 256;

/// vello and what it draws to.
struct Drawing {
    gpu: Device,
    renderer: Renderer,
    picture: wgpu::TextureView,
}

impl Drawing {
    fn open() -> Result<(wgpu::Adapter, Self), Box<dyn Error>> {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
        let adapter = pollster::block_on(instance.request_adapter(&Default::default()))?;
        let required_features = fathom_clock::features(&adapter);
        let descriptor = wgpu::DeviceDescriptor { required_features, ..Default::default() };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))?;
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: EDGE, height: EDGE, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::STORAGE_BINDING,
            view_formats: &[],
        });
        let antialiasing_support = AaSupport::area_only();
        let options = RendererOptions { antialiasing_support, ..Default::default() };
        let renderer = Renderer::new(&device, options)?;
        let gpu = Device::new(&adapter, device, queue);
        Ok((adapter, Self { gpu, renderer, picture: texture.create_view(&Default::default()) }))
    }

    fn render(&mut self, scene: &Scene) -> Result<(), vello::Error> {
        let params = RenderParams {
            base_color: Color::WHITE,
            width: EDGE,
            height: EDGE,
            antialiasing_method: AaConfig::Area,
        };
        let Device { device, queue, .. } = &self.gpu;
        self.renderer.render_to_texture(device, queue, scene, &self.picture, &params)
    }

    /// What a program does that has no clock of fathom: the host waits before and after.
    fn plain_ns(&mut self, scene: &Scene, clock: HostClock) -> Result<f64, Box<dyn Error>> {
        self.gpu.device.poll(wgpu::PollType::wait_indefinitely())?;
        let start_ns = clock.now_ns();
        self.render(scene)?;
        self.gpu.device.poll(wgpu::PollType::wait_indefinitely())?;
        Ok(clock.now_ns() - start_ns)
    }
}

/// The scene of this name. The changed one has so many times its paths.
fn scene(name: &str, work: f64) -> Result<Scene, Box<dyn Error>> {
    let known = SCENES.into_iter().find(|(known, _)| *known == name).ok_or("no such scene")?;
    let factor = if name == CHANGED { work } else { 1.0 };
    let mut scene = Scene::new();
    for number in 0..(f64::from(known.1) * factor).round() as u32 {
        // Weyl's sequence in three dimensions: even for any number of paths.
        let [x, y, hue] = [0.8191725134, 0.6710436067, 0.5497004779]
            .map(|step| (f64::from(number) * step).fract());
        let center = Affine::translate((x * f64::from(EDGE), y * f64::from(EDGE)));
        let color = Color::new([hue as f32, y as f32, 1.0 - hue as f32, 0.5]);
        let (path, radius) = (leaf(), 4.0 + 8.0 * hue);
        if number % 2 == 0 {
            scene.fill(Fill::NonZero, center * Affine::scale(radius), color, None, &path);
        } else {
            scene.stroke(&Stroke::new(0.1), center * Affine::scale(radius), color, None, &path);
        }
    }
    Ok(scene)
}

/// Eight curves around the origin.
fn leaf() -> BezPath {
    let at = |turn: f64, radius: f64| {
        let (y, x) = (turn * std::f64::consts::TAU / 8.0).sin_cos();
        Point::new(radius * x, radius * y)
    };
    let mut path = BezPath::new();
    path.move_to(at(0.0, 1.0));
    for turn in (0..8).map(f64::from) {
        path.curve_to(at(turn + 0.3, 1.4), at(turn + 0.7, 0.2), at(turn + 1.0, 1.0));
    }
    path.close_path();
    path
}

fn measure(work: f64, plain: bool, folder: &str) -> Result<(), Box<dyn Error>> {
    let (adapter, mut drawing) = Drawing::open()?;
    let Device { device, queue, .. } = &drawing.gpu;
    let device = device.clone();
    let mut clock = FrameClock::new(&adapter, &device, queue)?;
    let host = HostClock::from_plan(&clock.audit().plan);
    for (name, _) in SCENES {
        let scene = scene(name, work)?;
        let mut plain_ns = Vec::new();
        while clock.wants_frame() {
            let mut frame = clock.frame();
            frame.submission("vello", || drawing.render(&scene))??;
            frame.submit(device.create_command_encoder(&Default::default()))?;
            if plain {
                plain_ns.push(drawing.plain_ns(&scene, host)?);
            }
        }
        clock.end_cell("vello-frames", &format!("scene={name}"))?;
        if plain {
            let time = StageRecord::new("plain", Clock::Host, plain_ns, &[]).time;
            let [low, high] = time.ends().map(|ns| ns * 1e-6);
            println!("{name}: {:.4} ms ({low:.4} … {high:.4}) plain", time.median * 1e-6);
        }
    }
    print!("{clock}");
    Ok(clock.write(folder.as_ref())?)
}

fn factor(text: Option<String>) -> Result<f64, &'static str> {
    let number = text.and_then(|text| text.parse().ok());
    number
        .filter(|factor| (0.0..=100.0).contains(factor))
        .ok_or("--work needs a factor from 0 to 100")
}

fn main() -> Result<(), Box<dyn Error>> {
    let (mut work, mut folder) = (1.0, "vello-frames".to_owned());
    let [mut plain, mut counted, mut worker] = [false; 3];
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--work" => work = factor(arguments.next())?,
            "--plain" => plain = true,
            "--counted" => counted = true,
            "--worker" => worker = true,
            option if option.starts_with('-') => Err(format!("no option {option}"))?,
            _ => folder = argument,
        }
    }
    if worker {
        return worker::serve(work, counted);
    }
    measure(work, plain, &folder)
}
