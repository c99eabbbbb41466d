//! What a graphics card is given to do in a step: how often each kernel is launched, and how long the card takes for it.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::sync::{Arc, Mutex, PoisonError};

use burn_cubecl::cubecl::config::{TypeNameFormatLevel, type_name_format};
use burn_cubecl::cubecl::future::block_on;
use burn_cubecl::cubecl::logging::{
    Duration, LaunchObservation, LaunchObserver, ProfileDuration, TimingMethod, TimingRequest,
};

/// Launches of all kernels since it was made.
pub struct Launches {
    seen: Arc<Seen>,
    _observation: LaunchObservation,
}

#[derive(Default)]
struct Seen {
    times_too: bool,
    launched: Mutex<BTreeMap<&'static str, usize>>,
    measured: Mutex<Vec<(&'static str, ProfileDuration)>>,
}

impl LaunchObserver for Seen {
    fn launched(&self, kernel: &'static str) {
        *self.launched.lock().unwrap_or_else(PoisonError::into_inner).entry(kernel).or_default() += 1;
    }

    fn timing(&self) -> TimingRequest {
        if self.times_too { TimingRequest::Deferred } else { TimingRequest::None }
    }

    fn profiled(&self, kernel: &'static str, profile: ProfileDuration) {
        self.measured.lock().unwrap_or_else(PoisonError::into_inner).push((kernel, profile));
    }

    fn timed(&self, _kernel: &'static str, _duration: Duration, _method: TimingMethod) {}
}

impl Launches {
    /// Counts from now on; with `times_too` each launch is timed by the card's own clock, which slows the run.
    pub fn count(times_too: bool) -> Self {
        let seen = Arc::new(Seen { times_too, ..Seen::default() });
        let _observation = LaunchObservation::new(Arc::clone(&seen) as Arc<dyn LaunchObserver>);
        Self { seen, _observation }
    }

    /// A line for each kernel, `kernel,launches_a_step,microseconds_a_step`, the longest first, and one for all.
    pub fn table(self, n_steps: usize) -> String {
        let Self { seen, _observation } = self;
        drop(_observation);
        let measured = std::mem::take(&mut *seen.measured.lock().unwrap_or_else(PoisonError::into_inner));
        let mut seconds: BTreeMap<&str, f64> = BTreeMap::new();
        for (kernel, profile) in measured {
            if let Some(ticks) = block_on(profile.resolve()) {
                *seconds.entry(kernel).or_default() += ticks.duration().as_secs_f64();
            }
        }
        let launched = seen.launched.lock().unwrap_or_else(PoisonError::into_inner);
        let a_step = |sum: f64| sum / n_steps.max(1) as f64;
        let row = |(kernel, n): (&&'static str, &usize)| {
            let name = type_name_format(kernel, TypeNameFormatLevel::Balanced).replace(',', ";");
            (name, a_step(*n as f64), 1e6 * a_step(seconds.get(*kernel).copied().unwrap_or_default()))
        };
        let mut rows: Vec<(String, f64, f64)> = launched.iter().map(row).collect();
        rows.sort_by(|a, b| b.2.total_cmp(&a.2).then(b.1.total_cmp(&a.1)));
        let all = rows.iter().fold(("all".to_owned(), 0.0, 0.0), |all, row| (all.0, all.1 + row.1, all.2 + row.2));
        rows.push(all);
        let mut table = "kernel,launches_a_step,microseconds_a_step\n".to_owned();
        for (kernel, launches, microseconds) in rows {
            // Writing to a string cannot fail.
            let _ = writeln!(table, "{kernel},{launches:.1},{microseconds:.1}");
        }
        table
    }
}
