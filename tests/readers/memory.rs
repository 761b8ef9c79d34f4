//! Counts the memory that each thread holds, so that a test can say how much a reader took.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    static HELD: Cell<usize> = const { Cell::new(0) };
    static PEAK: Cell<usize> = const { Cell::new(0) };
    static EVER: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator, counted.
pub struct Counting;

fn taken(bytes: usize) {
    // A thread that ends has no counter any more.
    let _ = EVER.try_with(|ever| ever.set(ever.get().saturating_add(bytes)));
    let _ = HELD.try_with(|held| {
        let now = held.get().saturating_add(bytes);
        held.set(now);
        let _ = PEAK.try_with(|peak| peak.set(peak.get().max(now)));
    });
}

/// What another thread took counts as nothing here.
fn given_back(bytes: usize) {
    let _ = HELD.try_with(|held| held.set(held.get().saturating_sub(bytes)));
}

// SAFETY: every call goes to the system's allocator as it came; counting touches no memory of the caller's.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        taken(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        taken(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        given_back(layout.size());
        unsafe { System.dealloc(place, layout) }
    }

    unsafe fn realloc(&self, place: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        given_back(layout.size());
        taken(size);
        unsafe { System.realloc(place, layout, size) }
    }
}

/// What `work` gives, and the most bytes that this thread held in it beyond those of before.
pub fn peak_of<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let before = HELD.get();
    PEAK.set(before);
    let result = work();
    (result, PEAK.get() - before)
}

/// What `work` gives, and how many bytes this thread took in it.
pub fn allocated_by<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let before = EVER.get();
    let result = work();
    (result, EVER.get() - before)
}

#[test]
fn what_is_taken_and_given_back_is_counted() {
    let (_, peak) = peak_of(|| {
        drop(vec![1u8; 3 << 20]);
        vec![1u8; 1 << 20]
    });
    assert!((3 << 20..4 << 20).contains(&peak), "{peak}");
    let (_, ever) = allocated_by(|| (0..4).for_each(|_| drop(vec![1u8; 1 << 20])));
    assert!((4 << 20..5 << 20).contains(&ever), "{ever}");
}
