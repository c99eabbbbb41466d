//! Sharing work among threads without starting any: the threads of the rayon pool in which the caller runs, or the
//! caller's own.
//!
//! A controller that wants several threads runs inside a pool of its own (`pool.install(|| ...)`); one that does not gets
//! one thread. The bits of a result do not depend on it.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

fn is_in_pool() -> bool {
    rayon::current_thread_index().is_some()
}

/// Calls `work` with each block of `length` values of `out` and its index; `start` makes the scratch space of a thread.
pub(crate) fn for_each_block<T: Send, S>(
    out: &mut [T],
    length: usize,
    start: impl Fn() -> S + Send + Sync,
    work: impl Fn(&mut S, usize, &mut [T]) + Send + Sync,
) {
    if is_in_pool() {
        let blocks = out.par_chunks_mut(length).enumerate();
        blocks.for_each_init(start, |scratch, (index, block)| work(scratch, index, block));
    } else {
        let mut scratch = start();
        out.chunks_mut(length).enumerate().for_each(|(index, block)| work(&mut scratch, index, block));
    }
}

/// So many values, zeros that `work` is called with as [`for_each_block`] does: each thread sets its own blocks to zero just
/// before, so that they are in its cache and no thread waits for it.
pub(crate) fn made_by_blocks<S>(
    n: usize,
    length: usize,
    start: impl Fn() -> S + Send + Sync,
    work: impl Fn(&mut S, usize, &mut [f32]) + Send + Sync,
) -> Vec<f32> {
    let mut out: Vec<f32> = Vec::with_capacity(n);
    for_each_block(&mut out.spare_capacity_mut()[..n], length, start, |scratch, index, block| {
        block.iter_mut().for_each(|value| {
            value.write(0.0);
        });
        #[expect(unsafe_code, reason = "each value was written just above")]
        let block = unsafe { block.assume_init_mut() };
        work(scratch, index, block);
    });
    #[expect(unsafe_code, reason = "the blocks are all of the first n values, and each was written")]
    unsafe {
        out.set_len(n);
    }
    out
}

/// What `work` makes of each number of a range, in order; as many are in work at a time as the caller's pool has threads.
///
/// A parallel iterator begins further ones while one waits for what it shared out itself, an embedding, say: then any number
/// of them are held in memory at once, and the time that one is seen to take contains others.
///
/// # Errors
/// The first in order that `work` returns; what comes after it may not be begun.
pub fn each<T: Send, E: Send>(range: Range<usize>, work: impl Fn(usize) -> Result<T, E> + Sync) -> Result<Vec<T>, E> {
    let (next, is_over) = (AtomicUsize::new(range.start), AtomicBool::new(false));
    let of_thread = |_: rayon::BroadcastContext<'_>| {
        let mut made = Vec::new();
        while !is_over.load(Ordering::Relaxed) {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= range.end {
                break;
            }
            let result = work(index);
            is_over.fetch_or(result.is_err(), Ordering::Relaxed);
            made.push((index, result));
        }
        made
    };
    let mut made: Vec<(usize, Result<T, E>)> = rayon::broadcast(of_thread).into_iter().flatten().collect();
    made.sort_unstable_by_key(|(index, _)| *index);
    made.into_iter().map(|(_, result)| result).collect()
}

/// What `work` makes of each number below `n`, in order.
pub(crate) fn map<T: Send>(n: usize, work: impl Fn(usize) -> T + Send + Sync) -> Vec<T> {
    if is_in_pool() { (0..n).into_par_iter().map(work).collect() } else { (0..n).map(work).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pool<T: Send>(n_threads: usize, work: impl FnOnce() -> T + Send) -> T {
        rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap().install(work)
    }

    #[test]
    fn no_more_are_in_work_than_there_are_threads() {
        let (in_work, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let work = |index: usize| {
            most.fetch_max(in_work.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
            // Shared out: whoever waits for it is free to do other work of the pool.
            let sum: usize = (0..2_000_usize).into_par_iter().map(|i| i % (index + 1)).sum();
            in_work.fetch_sub(1, Ordering::SeqCst);
            Ok::<_, ()>(sum)
        };
        let alone: Vec<usize> = (3..90).map(|index| (0..2_000).map(|i| i % (index + 1)).sum()).collect();
        for n_threads in [1, 3] {
            assert_eq!(pool(n_threads, || each(3..90, work)), Ok(alone.clone()));
            assert!(most.load(Ordering::SeqCst) <= n_threads);
        }
        assert_eq!(pool(2, || each(5..5, work)), Ok(Vec::new()));
    }

    #[test]
    fn the_first_error_in_order_is_returned() {
        for _ in 0..20 {
            let work = |index: usize| if index % 10 == 7 { Err(index) } else { Ok(index) };
            assert_eq!(pool(3, || each(0..100, work)), Err(7));
        }
    }
}
