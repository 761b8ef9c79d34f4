//! Choosing and opening an adapter.

use std::ops::Deref;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock, PoisonError};

use super::pipelines::Pipelines;
use super::shader::ShaderCache;
use super::{Capacity, GpuError, TimedStage, mask};
use fathom_base::embedded::{Folders, SHADERS};
use fathom_clock::{ClockPlan, Device, FrameTimer, SubmitCost, catch_panic, describe};
use fathom_record as record;
use fathom_record::{Feature, Mask};
use serde::Serialize;
use strum::IntoEnumIterator;

/// What is lost without a feature.
fn loss(feature: Feature) -> &'static str {
    match feature {
        Feature::TimestampQuery => {
            "no timestamp queries: every pass is timed by a fenced host clock"
        }
        Feature::TimestampQueryInsideEncoders => {
            "no timestamps between passes: copies are timed by a fenced host clock"
        }
        Feature::PipelineStatisticsQuery => {
            "no pipeline statistics: shader invocations are not counted"
        }
        Feature::Float32Blendable => {
            "no blending of 32-bit float targets: light is summed in 16-bit floats"
        }
        Feature::Float32Filterable => {
            "no filtering of 32-bit float textures: they are read unfiltered"
        }
    }
}

/// How to choose and open an adapter.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Part of an adapter's name (any case) or its index in [`Gpu::list`]. Without it the variables
    /// `WGPU_ADAPTER_NAME` and `WGPU_BACKEND` count, and then a hardware GPU is preferred to a software driver.
    pub adapter: Option<String>,
    /// Compile shaders without wgpu's bounds and loop checks.
    pub unchecked: bool,
    /// Let a software adapter take all memory and any time.
    pub allow_large: bool,
    /// What is taken away from the adapter.
    pub mask: Mask,
    /// Where shaders are looked for; fathom's own if none is given.
    pub shaders: Option<Folders>,
    /// No better limits than these; the adapter's own if none are given.
    pub limits: Option<wgpu::Limits>,
    /// The folder that wgpu's trace of the device is written into.
    pub trace: Option<PathBuf>,
}

impl Options {
    /// As fathom's command line takes them; shaders are not among them.
    pub fn to_args(&self) -> Vec<String> {
        let option = |name: &str, value: &dyn ToString| [name.to_owned(), value.to_string()];
        let Mask { without } = &self.mask;
        let valued = self.adapter.iter().map(|name| option("--adapter", name));
        let valued = valued.chain(without.iter().map(|feature| option("--without", feature)));
        let flags = [("--unchecked", self.unchecked), ("--allow-large", self.allow_large)];
        let set = flags.into_iter().filter(|(_, is_set)| *is_set);
        valued.flatten().chain(set.map(|(flag, _)| flag.to_owned())).collect()
    }
}

#[derive(Clone, Debug, Serialize)]
pub struct AdapterEntry {
    #[serde(flatten)]
    pub adapter: record::Adapter,
    /// What it lacks, so that it cannot be opened.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lacks: Option<String>,
}

/// An open device with all the limits and all the optional features that its adapter offers and the mask leaves.
pub struct Gpu {
    watched: Device,
    /// The limits, and on a software adapter those of the machine.
    pub capacity: Capacity,
    /// What this adapter lacks and what that degrades, one sentence each.
    pub notes: Vec<String>,
    /// Results of [`Gpu::shader`].
    pub(super) shaders: Arc<ShaderCache>,
    pub(super) pipelines: Arc<Pipelines>,
    /// It allocates nothing: see [`Gpu::planner`].
    planner: bool,
    pub(super) folders: Folders,
}

/// The device, its queue, and what is known of it.
impl Deref for Gpu {
    type Target = Device;

    fn deref(&self) -> &Device {
        &self.watched
    }
}

/// An adapter, and the instance flags it was found with.
type FlaggedAdapter = (wgpu::Adapter, wgpu::InstanceFlags);

/// Adapters of every interface, the preferred one first.
fn enumerate_adapters() -> Vec<FlaggedAdapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    descriptor.flags = wgpu::InstanceFlags::empty().with_env();
    let (backends, flags) = (descriptor.backends, descriptor.flags);
    let instance = wgpu::Instance::new(descriptor);
    let mut all = pollster::block_on(instance.enumerate_adapters(backends - wgpu::Backends::NOOP));
    all.sort_by_key(rank);
    all.into_iter().map(|adapter| (adapter, flags)).collect()
}

/// Hardware before software, discrete before integrated.
fn rank(adapter: &wgpu::Adapter) -> (bool, u8) {
    let kind = match adapter.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    };
    (describe(adapter).software, kind)
}

/// The index of the adapter named or numbered by `asked`.
fn find(names: &[String], asked: &str) -> Option<usize> {
    let wanted = asked.to_lowercase();
    let by_name = names.iter().position(|name| name.to_lowercase().contains(&wanted));
    match asked.parse::<usize>() {
        Ok(index) if index < names.len() => Some(index),
        _ => by_name,
    }
}

/// The chosen adapter, by `--adapter`, then by `WGPU_ADAPTER_NAME`, then by preference.
fn choose(asked: Option<&str>) -> Result<FlaggedAdapter, GpuError> {
    let from_environment = std::env::var("WGPU_ADAPTER_NAME").ok().filter(|name| !name.is_empty());
    let asked = asked.map(str::to_owned).or(from_environment);
    let mut all = enumerate_adapters();
    if let Some(index) = position(&all, asked.as_deref()) {
        return Ok(all.swap_remove(index));
    }
    match asked {
        Some(asked) if !all.is_empty() => {
            let numbered = names(&all).into_iter().enumerate();
            let available = numbered.map(|(index, name)| format!("{index} {name}"));
            Err(GpuError::UnknownAdapter {
                asked,
                available: available.collect::<Vec<_>>().join(", "),
            })
        }
        _ => {
            let tried = std::env::var("WGPU_BACKEND")
                .map_or_else(|_| String::new(), |backend| format!(" (WGPU_BACKEND={backend})"));
            Err(GpuError::NoAdapter { tried })
        }
    }
}

fn names(all: &[FlaggedAdapter]) -> Vec<String> {
    all.iter().map(|(adapter, _)| adapter.get_info().name).collect()
}

/// The index of the adapter that is asked for; of the first if none is.
fn position(all: &[FlaggedAdapter], asked: Option<&str>) -> Option<usize> {
    match asked {
        Some(asked) => find(&names(all), asked),
        None => (!all.is_empty()).then_some(0),
    }
}

/// What the adapter lacks that no pipeline can do without.
fn lacks(adapter: &wgpu::Adapter) -> Option<String> {
    let required = [
        (wgpu::DownlevelFlags::COMPUTE_SHADERS, "compute shaders"),
        (wgpu::DownlevelFlags::VERTEX_STORAGE, "storage buffers in vertex shaders"),
        (wgpu::DownlevelFlags::FRAGMENT_STORAGE, "storage buffers in fragment shaders"),
        (wgpu::DownlevelFlags::DEPTH_TEXTURE_AND_BUFFER_COPIES, "copies of depth textures"),
        (wgpu::DownlevelFlags::READ_ONLY_DEPTH_STENCIL, "depth that is tested and read at a time"),
    ];
    let flags = adapter.get_downlevel_capabilities().flags;
    let missing = required.iter().find(|(flag, _)| !flags.contains(*flag));
    missing.map(|(_, missing)| (*missing).to_owned())
}

/// The optional features of this adapter, and a note for each that it lacks.
fn negotiate(available: wgpu::Features) -> (wgpu::Features, Vec<String>) {
    let (there, lost): (Vec<_>, Vec<_>) =
        Feature::iter().partition(|feature| available.contains(mask::to_wgpu(*feature)));
    (mask::all_to_wgpu(&there), lost.into_iter().map(|feature| loss(feature).to_owned()).collect())
}

impl Gpu {
    /// All adapters of this machine, in the order of `--adapter INDEX`; the first is the default.
    /// Timestamp periods are known only of open devices and are 0 here.
    pub fn list() -> Vec<AdapterEntry> {
        let listed = |(adapter, _): &FlaggedAdapter| AdapterEntry {
            adapter: describe(adapter),
            lacks: lacks(adapter),
        };
        enumerate_adapters().iter().map(listed).collect()
    }

    /// What the chosen adapter is; it is not opened.
    pub fn choose(options: &Options) -> Result<record::Adapter, GpuError> {
        Ok(describe(&choose(options.adapter.as_deref())?.0))
    }

    /// Opens the chosen adapter.
    pub fn open(options: &Options) -> Result<Gpu, GpuError> {
        let (chosen, flags) = choose(options.adapter.as_deref())?;
        Self::open_adapter(chosen, flags, options)
    }

    /// A device on which pipelines are planned: its textures and buffers have sizes and no memory, and its pipelines are never run.
    /// What a pipeline needs is counted on it before the real one is made.
    ///
    /// # Errors
    /// wgpu was built without its `noop` backend.
    pub fn planner() -> Result<&'static Gpu, GpuError> {
        static PLANNER: OnceLock<Option<Gpu>> = OnceLock::new();
        let open = || {
            let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
            descriptor.backends = wgpu::Backends::NOOP;
            descriptor.backend_options.noop.enable = true;
            let instance = wgpu::Instance::new(descriptor);
            let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::NOOP));
            let flags = wgpu::InstanceFlags::empty();
            let gpu = Self::open_adapter(adapters.into_iter().next()?, flags, &Options::default());
            Some(Gpu { planner: true, ..gpu.ok()? })
        };
        PLANNER
            .get_or_init(open)
            .as_ref()
            .ok_or(GpuError::NoAdapter { tried: " to plan with".into() })
    }

    /// Whether this is [`Gpu::planner`].
    pub fn is_planner(&self) -> bool {
        self.planner
    }

    fn open_adapter(
        chosen: wgpu::Adapter,
        flags: wgpu::InstanceFlags,
        options: &Options,
    ) -> Result<Gpu, GpuError> {
        let mask = options.mask.clone();
        let features = mask::apply(&mask, chosen.features());
        let limits = match &options.limits {
            Some(max) => chosen.limits().or_worse_values_from(max),
            None => chosen.limits(),
        };
        let adapter = record::Adapter { mask, ..describe(&chosen) };
        if let Some(missing) = lacks(&chosen) {
            let adapter = format!("{} ({})", adapter.title(), adapter.backend);
            return Err(GpuError::Missing { adapter, missing });
        }
        let (features, mut notes) = negotiate(features);
        let writes = wgpu::DownlevelFlags::FRAGMENT_WRITABLE_STORAGE;
        let read_only_fragments = !chosen.get_downlevel_capabilities().flags.contains(writes);
        let loss = "fragment shaders write no storage: slicemaps, sliced rays and counts of samples are refused";
        notes.extend(read_only_fragments.then(|| loss.to_owned()));
        if !flags.is_empty() {
            notes.push(format!("instance flags from the environment slow every call: {flags:?}"));
        }
        let (device, queue) =
            request(&chosen, &adapter, (features, limits), options.trace.clone())?;
        let pipelines = Arc::new(Pipelines::default());
        let shaders = Arc::new(ShaderCache::default());
        let caches = (Arc::clone(&pipelines), Arc::clone(&shaders));
        // A pipeline or a shader made in a scope that caught an error may be invalid.
        let mut watched = Device::new(&chosen, device, queue).with_fault_handler(move || {
            caches.0.keep(0);
            caches.1.lock().unwrap_or_else(PoisonError::into_inner).clear();
        });
        watched.unchecked = options.unchecked;
        watched.adapter.mask = adapter.mask;
        Ok(Gpu {
            capacity: Capacity {
                read_only_fragments,
                ..Capacity::new(watched.limits.clone(), &watched.adapter, options.allow_large)
            },
            watched,
            notes,
            shaders,
            pipelines,
            planner: false,
            folders: options.shaders.clone().unwrap_or_else(|| Folders::new(SHADERS)),
        })
    }

    /// See [`Device::catch`].
    pub fn catch<T>(&self, f: impl FnOnce() -> Result<T, GpuError>) -> Result<T, GpuError> {
        self.watched.catch(f)
    }

    /// Runs stages as one untimed frame and waits for it.
    pub fn run<S: TimedStage + ?Sized>(&self, stages: &[&S]) -> Result<(), GpuError> {
        // The limit is on timed passes, and there are none.
        let plan = ClockPlan::fenced(SubmitCost::default());
        FrameTimer::new(self, plan, 1)?.run_stages(self, stages)?;
        Ok(())
    }
}

fn request(
    chosen: &wgpu::Adapter,
    adapter: &record::Adapter,
    (features, limits): (wgpu::Features, wgpu::Limits),
    trace: Option<PathBuf>,
) -> Result<(wgpu::Device, wgpu::Queue), GpuError> {
    let descriptor = wgpu::DeviceDescriptor {
        label: Some("fathom"),
        required_features: features,
        required_limits: limits,
        experimental_features: wgpu::ExperimentalFeatures::disabled(),
        // A software driver's GPU memory is the machine's own.
        memory_hints: if adapter.software {
            wgpu::MemoryHints::MemoryUsage
        } else {
            wgpu::MemoryHints::Performance
        },
        trace: trace.map_or(wgpu::Trace::Off, wgpu::Trace::Directory),
    };
    let opened = catch_panic(|| pollster::block_on(chosen.request_device(&descriptor)));
    let opened = opened.and_then(|opened| opened.map_err(|error| error.to_string()));
    opened.map_err(|reason| GpuError::Open { adapter: adapter.name.clone(), reason })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_adapter_is_found_by_index_or_part_of_its_name() {
        let names = ["NVIDIA H200".to_owned(), "llvmpipe (LLVM 15)".to_owned()];
        assert_eq!(find(&names, "1"), Some(1));
        assert_eq!(find(&names, "LLVMpipe"), Some(1));
        assert_eq!(find(&names, "h200"), Some(0));
        assert_eq!(find(&names, "200"), Some(0));
        assert_eq!(find(&names, "radeon"), None);
    }

    #[test]
    fn each_missing_optional_feature_leaves_a_note() {
        let (features, notes) = negotiate(wgpu::Features::TIMESTAMP_QUERY);
        assert_eq!(features, wgpu::Features::TIMESTAMP_QUERY);
        assert_eq!(notes.len(), Feature::iter().count() - 1);
        assert!(negotiate(wgpu::Features::all()).1.is_empty());
    }
}
