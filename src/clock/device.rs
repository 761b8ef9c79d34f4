//! A device, what is known of it, and its faults as errors.

use std::cell::{Cell, RefCell};
use std::panic::{self, AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, Once, PoisonError, mpsc};
use std::time::Duration;

use super::DeviceError;
use fathom_record::{Adapter, Mask};

/// Longest time of a submission. Drivers of GPUs end one that hangs after 2 to 60 s, if they do. A software driver may be asked for
/// frames of minutes.
const LONGEST_ON_GPU: Duration = Duration::from_secs(60);
const LONGEST_IN_SOFTWARE: Duration = Duration::from_secs(600);

/// An open device with its queue. Its faults come back as errors from the call that caused them.
pub struct Device {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub adapter: Adapter,
    pub features: wgpu::Features,
    pub limits: wgpu::Limits,
    /// Shaders run without wgpu's bounds and loop checks, those of the audit too.
    pub unchecked: bool,
    faults: Arc<Mutex<DeviceFaults>>,
    on_fault: Option<OnFault>,
    longest_submission: Duration,
}

/// Called when an error scope has caught a fault.
type OnFault = Box<dyn Fn() + Send + Sync>;

/// What the device reported outside any error scope.
#[derive(Default)]
struct DeviceFaults {
    uncaptured: Vec<wgpu::Error>,
    lost: Option<String>,
}

thread_local! {
    /// Depth of nested [`Device::catch`] calls on this thread: only the outermost one opens error scopes.
    static SCOPES: Cell<u32> = const { Cell::new(0) };
    /// What wgpu's panic within the open [`catch_panic`] said; none outside of one.
    static PANIC: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// What the adapter tells of itself. The period of its timestamps is known only of an open device and is 0 here.
pub fn describe(adapter: &wgpu::Adapter) -> Adapter {
    let info = adapter.get_info();
    Adapter {
        software: is_software(&info),
        backend: format!("{:?}", info.backend).to_lowercase(),
        device_type: format!("{:?}", info.device_type),
        name: info.name,
        driver: info.driver,
        driver_info: info.driver_info,
        vendor_id: info.vendor,
        device_id: info.device,
        timestamp_period_ns: 0.0,
        host_threads: std::thread::available_parallelism().map_or(1, usize::from),
        mask: Mask::default(),
    }
}

fn is_software(info: &wgpu::AdapterInfo) -> bool {
    let name = info.name.to_lowercase();
    info.device_type == wgpu::DeviceType::Cpu
        || ["llvmpipe", "lavapipe", "swiftshader", "softpipe"].iter().any(|s| name.contains(s))
}

impl Device {
    /// A device of this adapter. Its handlers of errors stay as they are: see [`Self::with_fault_handler`].
    pub fn new(adapter: &wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let about = describe(adapter);
        let timestamp_period_ns = queue.get_timestamp_period();
        Self {
            longest_submission: if about.software { LONGEST_IN_SOFTWARE } else { LONGEST_ON_GPU },
            adapter: Adapter { timestamp_period_ns, ..about },
            features: device.features(),
            limits: device.limits(),
            unchecked: false,
            faults: Arc::default(),
            on_fault: None,
            device,
            queue,
        }
    }

    fn lose(&self, reason: String) {
        let mut faults = self.faults.lock().unwrap_or_else(PoisonError::into_inner);
        faults.lost.get_or_insert(reason);
    }

    /// Why the device is lost, where it is.
    pub fn loss_reason(&self) -> Option<String> {
        self.faults.lock().unwrap_or_else(PoisonError::into_inner).lost.clone()
    }

    /// Takes over the device's handlers: errors outside any scope and the loss of the device come from the next call
    /// instead of panicking. `on_fault` is called when a scope has caught an error.
    #[must_use]
    pub fn with_fault_handler(mut self, on_fault: impl Fn() + Send + Sync + 'static) -> Self {
        self.on_fault = Some(Box::new(on_fault));
        let sink = Arc::clone(&self.faults);
        self.device.on_uncaptured_error(Arc::new(move |error| {
            sink.lock().unwrap_or_else(PoisonError::into_inner).uncaptured.push(error);
        }));
        let sink = Arc::clone(&self.faults);
        self.device.set_device_lost_callback(move |reason, message| {
            let lost = format!("{reason:?}: {message}");
            let lost = lost.trim_end_matches(": ").to_owned();
            sink.lock().unwrap_or_else(PoisonError::into_inner).lost = Some(lost);
        });
        self
    }

    /// Runs `f` and returns the first error the device raised meanwhile, if it raised one: a refused
    /// call, exhausted memory, an error of the driver, or the loss of the device, which a panic of wgpu counts as. May be nested.
    pub fn catch<T, E: From<DeviceError>>(&self, f: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        self.pending_fault()?;
        if SCOPES.get() > 0 {
            return f();
        }
        let _depth = ScopeDepth::enter();
        let filters = [
            wgpu::ErrorFilter::Validation,
            wgpu::ErrorFilter::OutOfMemory,
            wgpu::ErrorFilter::Internal,
        ];
        let [validation, memory, internal] = filters.map(|f| self.device.push_error_scope(f));
        let result = catch_panic(f).map_err(|panic| self.lose(panic));
        let captured = [internal, memory, validation].map(|scope| pollster::block_on(scope.pop()));
        self.pending_fault()?;
        match captured.into_iter().flatten().next() {
            Some(error) => {
                self.on_fault.iter().for_each(|on_fault| on_fault());
                Err(DeviceError::from(error).into())
            }
            None => result.unwrap_or_else(|()| unreachable!("the device is lost")),
        }
    }

    /// Waits until the GPU has done all that was submitted.
    ///
    /// # Errors
    /// The device was lost, or an error was raised outside any scope.
    pub fn wait(&self) -> Result<(), DeviceError> {
        self.wait_for(None)
    }

    /// Waits for one submission, or for the last.
    ///
    /// # Errors
    /// As [`Self::wait`].
    pub fn wait_for(&self, index: Option<wgpu::SubmissionIndex>) -> Result<(), DeviceError> {
        let timeout = Some(self.longest_submission);
        let outcome = self.poll(wgpu::PollType::Wait { submission_index: index, timeout });
        if outcome.is_err() {
            // A submission was refused. Only the next poll reports that the device is gone.
            let _ = self.poll(wgpu::PollType::Poll);
        }
        self.pending_fault().and(outcome)
    }

    fn poll(&self, poll: wgpu::PollType) -> Result<(), DeviceError> {
        match catch_panic(|| self.device.poll(poll)) {
            Ok(Ok(_)) => return Ok(()),
            Ok(Err(wgpu::PollError::Timeout)) => self.give_up(),
            Ok(Err(error)) => return Err(DeviceError::Internal(error.to_string())),
            Err(panic) => self.lose(panic),
        }
        self.pending_fault()
    }

    /// A submission hangs: the device counts as lost. It is never dropped, as that would wait for the submission and then panic.
    fn give_up(&self) {
        std::mem::forget((self.device.clone(), self.queue.clone()));
        let seconds = self.longest_submission.as_secs_f64();
        self.lose(format!("a submission did not end within {seconds} s"));
    }

    /// Submits what the queue holds back, such as writes to buffers, and waits for it.
    ///
    /// # Errors
    /// As [`Self::wait`].
    pub fn flush(&self) -> Result<(), DeviceError> {
        let index = self.queue.submit([]);
        self.wait_for(Some(index))
    }

    pub fn buffer(&self, label: &str, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size,
            usage,
            mapped_at_creation: false,
        })
    }

    /// A buffer with content. Where there is no memory for it, the scope has the error; wgpu's own function panics.
    pub fn filled(&self, label: &str, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: (bytes.len() as u64).next_multiple_of(wgpu::COPY_BUFFER_ALIGNMENT),
            usage,
            mapped_at_creation: !bytes.is_empty(),
        });
        if let Ok(mut view) = buffer.get_mapped_range_mut(..) {
            view.slice(..bytes.len()).copy_from_slice(bytes);
            drop(view);
            buffer.unmap();
        }
        buffer
    }

    /// A group of these buffers, bound from 0 on.
    pub fn bind(
        &self,
        label: &str,
        layout: &wgpu::BindGroupLayout,
        buffers: &[&wgpu::Buffer],
    ) -> wgpu::BindGroup {
        let entries = buffers.iter().zip(0..).map(|(buffer, binding)| wgpu::BindGroupEntry {
            binding,
            resource: buffer.as_entire_binding(),
        });
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(label),
            layout,
            entries: &entries.collect::<Vec<_>>(),
        })
    }

    /// Waits for the GPU, maps the first `bytes` of a buffer, and hands them to `read`.
    ///
    /// # Errors
    /// A fault of the device, or the buffer cannot be mapped.
    pub fn map<T>(
        &self,
        buffer: &wgpu::Buffer,
        bytes: u64,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, DeviceError> {
        let (sender, receiver) = mpsc::channel();
        buffer.map_async(wgpu::MapMode::Read, ..bytes, move |result| {
            // The receiver is gone only when waiting has failed, which is reported there.
            let _ = sender.send(result);
        });
        self.wait()?;
        let failed = |error: &dyn std::fmt::Display| DeviceError::ReadBack(error.to_string());
        receiver.try_recv().map_err(|e| failed(&e))?.map_err(|e| failed(&e))?;
        let view = buffer.get_mapped_range(..bytes).map_err(|error| failed(&error))?;
        let value = read(&view);
        drop(view);
        buffer.unmap();
        Ok(value)
    }

    /// The loss of the device, or an error raised outside any scope, once.
    fn pending_fault(&self) -> Result<(), DeviceError> {
        let mut faults = self.faults.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(reason) = &faults.lost {
            return Err(DeviceError::Lost(reason.clone()));
        }
        let mut errors = faults.uncaptured.drain(..);
        errors.next().map_or(Ok(()), |error| Err(error.into()))
    }
}

/// Runs calls of wgpu. Some of them panic where the device is lost or memory cannot be had: then what the panic says, of which nothing is
/// printed.
pub fn catch_panic<T>(f: impl FnOnce() -> T) -> Result<T, String> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let print = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            let is_of_wgpu = info.location().is_some_and(|place| place.file().contains("wgpu"));
            let text = info.to_string().lines().skip(1).collect::<Vec<_>>().join(" ");
            let is_open = || PANIC.with_borrow_mut(|open| open.as_mut().map(|open| *open = text));
            if !is_of_wgpu || is_open().is_none() {
                print(info);
            }
        }));
    });
    let outer = PANIC.replace(Some(String::new()));
    let result = catch_unwind(AssertUnwindSafe(f));
    let text = PANIC.replace(outer).filter(|text| !text.is_empty());
    result.map_err(|panic| text.unwrap_or_else(|| panic::resume_unwind(panic)))
}

/// Counts the nesting of scopes, also when a panic unwinds through them.
struct ScopeDepth;

impl ScopeDepth {
    fn enter() -> Self {
        SCOPES.set(SCOPES.get() + 1);
        ScopeDepth
    }
}

impl Drop for ScopeDepth {
    fn drop(&mut self) {
        SCOPES.set(SCOPES.get() - 1);
    }
}
