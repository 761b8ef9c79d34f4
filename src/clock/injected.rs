//! Faults of hardware that a development build makes up where [`VARIABLE`] names them, so that what a run does about them can be
//! tested without the hardware. `docs/faults.md` has the names. A release does not read the variable.

use std::str::FromStr;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

use crate::frame::Ticks;

/// `NAME` or `NAME=NUMBER`, several with commas between them.
const VARIABLE: &str = "FATHOM_FAULTS";
const STALL: Duration = Duration::from_secs(2);
/// By how much longer everything takes at the base clock than at the boost clock.
const BASE_CLOCK_ADDS: f64 = 0.5;

/// What is wrong with timestamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ClockFault {
    /// A tick takes so many ns.
    Period(f64),
    /// So many bits are valid, and the counter begins again at zero in the middle of every frame.
    Bits(u32),
    Zero,
    /// The end of a pass has the timestamp of its begin.
    Equal,
    Backwards,
    /// Timestamps are multiples of so many ns.
    Step(f64),
}

/// What happens to the device, once, at the Nth of a process's calls of this kind.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Event {
    /// The device is lost at a submission.
    Lost,
    /// A submission takes [`STALL`] longer.
    Stall,
    /// A submission does not end.
    Hang,
    /// From a submission on all of them take longer.
    Slow,
    /// The memory is exhausted at an allocation.
    Memory,
    /// A shader does not compile.
    Shader,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Injection {
    Clock(ClockFault),
    At(Event, u64),
}

impl FromStr for Injection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, number) = text.split_once('=').unwrap_or((text, "0"));
        let unknown = || format!("{VARIABLE}: there is no fault `{text}`; see docs/faults.md");
        let number: f64 = number.parse().map_err(|_| unknown())?;
        let at = |event| Self::At(event, number as u64);
        Ok(match name {
            "period" => Self::Clock(ClockFault::Period(number)),
            "bits" => Self::Clock(ClockFault::Bits(number as u32)),
            "zero" => Self::Clock(ClockFault::Zero),
            "equal" => Self::Clock(ClockFault::Equal),
            "backwards" => Self::Clock(ClockFault::Backwards),
            "step" => Self::Clock(ClockFault::Step(number)),
            "lost" => at(Event::Lost),
            "stall" => at(Event::Stall),
            "hang" => at(Event::Hang),
            "slow" => at(Event::Slow),
            "memory" => at(Event::Memory),
            "shader" => at(Event::Shader),
            _ => return Err(unknown()),
        })
    }
}

impl ClockFault {
    /// What is read of a frame instead of ticks of this period.
    pub(crate) fn distort(self, ticks: &mut [Ticks], period_ns: f64) {
        let (Some([first, _]), Some([_, last])) = (ticks.first(), ticks.last()) else { return };
        let middle = first + last.saturating_sub(*first) / 2;
        let each = |ticks: &mut [Ticks], of: &dyn Fn(u64) -> u64| {
            ticks.as_flattened_mut().iter_mut().for_each(|tick| *tick = of(*tick));
        };
        match self {
            Self::Period(ns) => each(ticks, &|tick| (tick as f64 * period_ns / ns) as u64),
            Self::Bits(bits) => each(ticks, &|tick| {
                tick.wrapping_sub(middle) & u64::MAX.unbounded_shr(u64::BITS - bits)
            }),
            Self::Zero => each(ticks, &|_| 0),
            Self::Step(ns) => {
                let step = (ns / period_ns).max(1.0) as u64;
                each(ticks, &|tick| tick - tick % step);
            }
            Self::Equal => ticks.iter_mut().for_each(|[begin, end]| *end = *begin),
            Self::Backwards => ticks.iter_mut().for_each(|ticks| ticks.swap(0, 1)),
        }
    }
}

/// Calls of each kind that this process has made, on all its devices.
static SUBMISSIONS: AtomicU64 = AtomicU64::new(0);
static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);
static SHADERS: AtomicU64 = AtomicU64::new(0);

/// The faults that a device is given.
#[derive(Debug, Default)]
pub(crate) struct Injected(Vec<Injection>);

impl Injected {
    /// What the environment asks for; nothing in a release.
    pub(crate) fn of_environment() -> Result<Self, String> {
        if !cfg!(debug_assertions) {
            return Ok(Self::default());
        }
        let asked = std::env::var(VARIABLE).unwrap_or_default();
        let names = asked.split(',').filter(|name| !name.is_empty());
        names.map(str::parse).collect::<Result<_, _>>().map(Self)
    }

    /// Records say that what they hold is made up.
    pub(crate) fn note(&self) -> Option<String> {
        (!self.0.is_empty()).then(|| format!("made-up faults of hardware: {:?}", self.0))
    }

    pub(crate) fn clock_faults(&self) -> impl Iterator<Item = ClockFault> {
        self.0.iter().filter_map(|injection| match injection {
            Injection::Clock(fault) => Some(*fault),
            Injection::At(..) => None,
        })
    }

    /// That of the faulty clock.
    pub(crate) fn period_ns(&self) -> Option<f64> {
        self.clock_faults().find_map(|fault| match fault {
            ClockFault::Period(ns) => Some(ns),
            _ => None,
        })
    }

    /// Counts a call, and says whether this happens at it. A device without faults counts nothing.
    fn is_due(&self, event: Event, calls: &AtomicU64) -> bool {
        !self.0.is_empty() && self.happens(event, calls.fetch_add(1, Relaxed) + 1)
    }

    fn happens(&self, event: Event, number: u64) -> bool {
        self.0.contains(&Injection::At(event, number))
    }

    /// A submission is waited for. Whether the device is lost now.
    pub(crate) fn submitted(&self) -> bool {
        let is_lost = self.is_due(Event::Lost, &SUBMISSIONS);
        let number = SUBMISSIONS.load(Relaxed);
        while self.happens(Event::Hang, number) {
            std::thread::park();
        }
        if self.happens(Event::Stall, number) {
            std::thread::sleep(STALL);
        }
        is_lost
    }

    /// A submission has ended that was waited for since `start`. The processor is kept busy, as a driver in software would keep it.
    pub(crate) fn ended(&self, start: Instant) {
        let number = SUBMISSIONS.load(Relaxed);
        let slow = |injection: &Injection| matches!(injection, Injection::At(Event::Slow, from) if *from <= number);
        if self.0.iter().any(slow) {
            let end = Instant::now() + start.elapsed().mul_f64(BASE_CLOCK_ADDS);
            while Instant::now() < end {
                std::hint::spin_loop();
            }
        }
    }

    /// Memory is allocated. Whether there is none left.
    pub(crate) fn allocated(&self) -> bool {
        self.is_due(Event::Memory, &ALLOCATIONS)
    }

    /// A shader is compiled. Whether that fails.
    pub(crate) fn compiled(&self) -> bool {
        self.is_due(Event::Shader, &SHADERS)
    }
}
