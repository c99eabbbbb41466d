//! Sharing work among threads without starting any: those of the rayon pool in which the caller runs, or the caller's own.
//!
//! A controller that wants several threads runs inside a pool of its own (`pool.install(|| ...)`); one that does not gets
//! one thread. The bits of a result do not depend on it.

use rayon::prelude::*;

fn is_in_pool() -> bool {
    rayon::current_thread_index().is_some()
}

/// Calls `work` with each block of `length` values of `out` and its index; `start` makes the scratch space of a thread.
pub(crate) fn for_each_block<S>(
    out: &mut [f32],
    length: usize,
    start: impl Fn() -> S + Send + Sync,
    work: impl Fn(&mut S, usize, &mut [f32]) + Send + Sync,
) {
    if is_in_pool() {
        let blocks = out.par_chunks_mut(length).enumerate();
        blocks.for_each_init(start, |scratch, (index, block)| work(scratch, index, block));
    } else {
        let mut scratch = start();
        out.chunks_mut(length).enumerate().for_each(|(index, block)| work(&mut scratch, index, block));
    }
}

/// What `work` makes of each number below `n`, in order.
pub(crate) fn map<T: Send>(n: usize, work: impl Fn(usize) -> T + Send + Sync) -> Vec<T> {
    if is_in_pool() { (0..n).into_par_iter().map(work).collect() } else { (0..n).map(work).collect() }
}
