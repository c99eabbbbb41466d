//! One thread that does jobs in order and never makes its owner wait.

use std::any::Any;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::{Builder, JoinHandle};

/// A thread that makes an outcome `O` of each job `J`.
#[derive(Debug)]
pub struct Worker<J, O> {
    /// `None` only while it is dropped.
    jobs: Option<SyncSender<(u64, J)>>,
    outcomes: Receiver<O>,
    thread: Option<JoinHandle<()>>,
    stops: Arc<AtomicBool>,
    capacity: usize,
    n_submitted: u64,
    n_polled: u64,
}

/// A job that was not accepted, and why.
#[derive(Debug, PartialEq)]
pub enum Refused<J> {
    /// As many jobs as the capacity have no polled outcome.
    Full(J),
    /// The thread has ended.
    Stopped(J),
}

impl<J: Send + 'static, O: Send + 'static> Worker<J, O> {
    /// Starts a thread that calls `work` with each job and its number, and `panicked` with the message where that panics.
    pub fn start(
        name: &str,
        capacity: usize,
        mut work: impl FnMut(u64, J) -> O + Send + 'static,
        panicked: impl Fn(u64, String) -> O + Send + 'static,
    ) -> io::Result<Self> {
        let (jobs, queue) = sync_channel::<(u64, J)>(capacity);
        // Jobs under way and outcomes not polled are together at most `capacity`: sending one never waits.
        let (done, outcomes) = sync_channel(capacity);
        let stops = Arc::new(AtomicBool::new(false));
        let stop = stops.clone();
        let serve = move || {
            while let Ok((number, job)) = queue.recv() {
                if stop.load(Ordering::Acquire) {
                    return;
                }
                // What a panic may have left half done is the business of `work`.
                let outcome = catch_unwind(AssertUnwindSafe(|| work(number, job)));
                let outcome = outcome.unwrap_or_else(|payload| panicked(number, message(payload.as_ref())));
                if done.send(outcome).is_err() {
                    return;
                }
            }
        };
        let thread = Some(Builder::new().name(name.into()).spawn(serve)?);
        Ok(Self { jobs: Some(jobs), outcomes, thread, stops, capacity, n_submitted: 0, n_polled: 0 })
    }

    /// Hands in a job and returns its number.
    pub fn submit(&mut self, job: J) -> Result<u64, Refused<J>> {
        if self.n_pending() >= self.capacity {
            return Err(Refused::Full(job));
        }
        let Some(jobs) = &self.jobs else { return Err(Refused::Stopped(job)) };
        match jobs.try_send((self.n_submitted, job)) {
            Ok(()) => {
                self.n_submitted += 1;
                Ok(self.n_submitted - 1)
            }
            Err(TrySendError::Full((_, job))) => Err(Refused::Full(job)),
            Err(TrySendError::Disconnected((_, job))) => Err(Refused::Stopped(job)),
        }
    }

    /// The next outcome, where there is one.
    pub fn poll(&mut self) -> Option<O> {
        let outcome = self.outcomes.try_recv().ok()?;
        self.n_polled += 1;
        Some(outcome)
    }

    /// Jobs without a polled outcome.
    pub fn n_pending(&self) -> usize {
        // At most the capacity.
        usize::try_from(self.n_submitted - self.n_polled).unwrap_or(usize::MAX)
    }

    /// The most jobs without a polled outcome.
    pub fn capacity(&self) -> usize {
        self.capacity
    }
}

impl<J, O> Drop for Worker<J, O> {
    fn drop(&mut self) {
        self.stops.store(true, Ordering::Release);
        // A thread that waits for a job wakes up to find that there will be none.
        self.jobs = None;
        if let Some(thread) = self.thread.take() {
            // It fails only where the thread panicked, and that has ended it as well.
            thread.join().ok();
        }
    }
}

/// What a panic said.
fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_else(|| "no message".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::{Sender, channel};
    use std::time::Duration;

    type Answer = (u64, Result<u32, String>);

    /// A worker that waits for a sign before each job, doubles it, and panics at 13.
    fn worker(capacity: usize) -> (Worker<u32, Answer>, Sender<()>) {
        let (go, gate) = channel();
        let work = move |number, job: u32| {
            gate.recv().ok();
            assert_ne!(job, 13, "job {job}");
            (number, Ok(2 * job))
        };
        (Worker::start("test", capacity, work, |number, message| (number, Err(message))).unwrap(), go)
    }

    fn wait<J: Send + 'static, O: Send + 'static>(worker: &mut Worker<J, O>) -> O {
        loop {
            match worker.poll() {
                Some(outcome) => return outcome,
                None => std::thread::sleep(Duration::from_millis(1)),
            }
        }
    }

    #[test]
    fn a_full_queue_gives_the_job_back_and_loses_none() {
        let (mut worker, go) = worker(3);
        assert_eq!([5, 6, 7].map(|job| worker.submit(job).unwrap()), [0, 1, 2]);
        assert_eq!(worker.submit(8), Err(Refused::Full(8)));
        assert!(worker.poll().is_none(), "the thread waits");
        (0..3).for_each(|_| go.send(()).unwrap());
        assert_eq!(wait(&mut worker), (0, Ok(10)));
        // The place of the polled one is free, whatever the thread does meanwhile.
        assert_eq!((worker.submit(8), worker.submit(9)), (Ok(3), Err(Refused::Full(9))));
        go.send(()).unwrap();
        assert_eq!([1, 2, 3].map(|_| wait(&mut worker)), [(1, Ok(12)), (2, Ok(14)), (3, Ok(16))]);
        assert_eq!(worker.n_pending(), 0);
    }

    #[test]
    fn a_panic_is_an_outcome_and_the_next_job_is_done() {
        let (mut worker, go) = worker(2);
        for job in [13, 4] {
            worker.submit(job).unwrap();
            go.send(()).unwrap();
        }
        let (number, answer) = wait(&mut worker);
        assert!(number == 0 && answer.unwrap_err().contains("job 13"));
        assert_eq!(wait(&mut worker), (1, Ok(8)));
    }

    #[test]
    fn dropping_a_busy_worker_finishes_its_job_and_does_no_other() {
        let (reports, done) = channel();
        let (started, begun) = channel();
        let work = move |_, job: u32| {
            started.send(()).unwrap();
            std::thread::sleep(Duration::from_millis(30));
            reports.send(job).unwrap();
        };
        let mut worker = Worker::start("test", 4, work, |_, _| ()).unwrap();
        (0..4).for_each(|job| assert!(worker.submit(job).is_ok()));
        begun.recv().unwrap();
        drop(worker);
        // The sender is gone with the thread, so this ends.
        assert_eq!(done.iter().collect::<Vec<_>>(), [0]);
    }
}
