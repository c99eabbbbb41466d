//! The terminal view of a node: in this process, on a network, or by its log while it grows.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use tactile_data::recording::ros::bag::Bag;

use crate::error::{Error, Result};
use crate::event::Topic;
use crate::log::{Line, Setup};
use crate::replay;
use crate::shell::is_asked;
use crate::shell::views::{Shown, is_shown};
use crate::watch::{Feed, Follower, run};

/// Messages that wait for the view at most.
const MAX_WAITING: usize = 4096;

/// Between two looks at a log that grows.
const LOOK: Duration = Duration::from_millis(500);

/// How the messages reach the view.
pub fn channel() -> (SyncSender<Shown>, Receiver<Shown>) {
    sync_channel(MAX_WAITING)
}

/// Shows what arrives until the user leaves or a stop is asked for.
///
/// # Errors
/// The standard output is no terminal.
pub fn show(receiver: &Receiver<Shown>, stop: &AtomicBool) -> Result<()> {
    let mut follower = Follower::default();
    run(|wait| feed(receiver, &mut follower, wait, stop)).map_err(Error::io("terminal"))
}

/// What came within a time.
fn feed(receiver: &Receiver<Shown>, follower: &mut Follower, wait: Duration, stop: &AtomicBool) -> Feed {
    if is_asked(stop) {
        return Feed::Stopped;
    }
    let deadline = Instant::now() + wait;
    let mut is_new = false;
    loop {
        match receiver.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
            Ok(Shown { time_ns, topic, cdr, .. }) => {
                follower.take(time_ns, topic, &cdr);
                is_new = true;
            }
            Err(RecvTimeoutError::Disconnected) if !is_new => return Feed::Ended,
            Err(_) => break,
        }
    }
    if is_new { Feed::View(Box::new(follower.view().clone())) } else { Feed::Same }
}

/// Sends the messages of a log, and of what is added to it, until it ends or nobody looks any more. `pace` is how many
/// times as fast as they were recorded; `None` as fast as it goes. Returns what the log is of.
///
/// # Errors
/// A file that is no log.
pub fn follow_log(log: PathBuf, pace: Option<f64>, sender: SyncSender<Shown>) -> Result<Setup> {
    let setup = replay::setup(&log)?;
    let of = setup.clone();
    std::thread::spawn(move || {
        // What goes wrong later ends the view's messages, not the view.
        drop(send_log(&log, &of, pace, &sender));
    });
    Ok(setup)
}

fn send_log(log: &Path, setup: &Setup, pace: Option<f64>, sender: &SyncSender<Shown>) -> Result<()> {
    let started = Instant::now();
    let (mut n_sent, mut start_ns, mut picture) = (0, None, None);
    loop {
        let bag = Bag::open(log)?;
        let mut messages = bag.messages();
        for message in messages.by_ref().skip(n_sent) {
            let message = message?;
            n_sent += 1;
            let time_ns = message.log_time_ns;
            let topic = match Line::of_message(&message, setup) {
                Some(Line::Output(topic)) if is_shown(topic) => topic,
                Some(line @ Line::Given(given)) if given.is_picture() => {
                    picture = Some((line, message));
                    continue;
                }
                _ => continue,
            };
            if let Some(pace) = pace {
                let since_s = (time_ns - *start_ns.get_or_insert(time_ns)) as f64 * 1e-9 / pace;
                std::thread::sleep(
                    Duration::try_from_secs_f64(since_s).unwrap_or_default().saturating_sub(started.elapsed()),
                );
            }
            let picture = picture.take_if(|_| topic == Topic::Decision);
            let picture = picture.and_then(|(line, message)| line.input(message.bytes().to_vec()));
            if sender.send(Shown { picture, ..Shown::new(time_ns, topic, message.bytes().to_vec()) }).is_err() {
                return Ok(());
            }
        }
        if messages.cuts().is_empty() {
            return Ok(());
        }
        std::thread::sleep(LOOK);
    }
}

/// Sends what a node publishes on a network, until nobody looks any more.
///
/// # Errors
/// Names that ROS 2 does not allow.
#[cfg(feature = "ros2")]
pub fn follow_network(
    bus: crate::ros2::Bus,
    inbox: crate::ros2::Inbox,
    node: &str,
    sender: SyncSender<Shown>,
) -> Result<()> {
    use crate::ros2::{Delivery, Incoming};
    use crate::sources::NodeClock;

    let mut topics = Vec::new();
    for topic in Topic::ALL.into_iter().filter(|topic| is_shown(*topic)) {
        let delivery = if topic.is_latched() { Delivery::Latched } else { Delivery::Reliable };
        topics.push((bus.subscribe(&topic.name().replacen('~', node, 1), topic.message()[0], delivery)?, topic));
    }
    std::thread::spawn(move || {
        let _bus = bus;
        let clock = NodeClock::start();
        loop {
            match inbox.recv_timeout(LOOK) {
                Ok(Incoming::Message { subscription, cdr, received, .. }) => {
                    let Some((_, topic)) = topics.iter().find(|(of, _)| *of == subscription) else { continue };
                    if sender.send(Shown::new(clock.at_ns(received), *topic, cdr)).is_err() {
                        return;
                    }
                }
                Err(RecvTimeoutError::Disconnected) => return,
                _ => {}
            }
        }
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::Ordering;

    #[test]
    fn a_stop_ends_the_view_whether_messages_come_or_not() {
        let (sender, receiver) = channel();
        let (mut follower, stop) = (Follower::default(), AtomicBool::new(false));
        let mut next = || feed(&receiver, &mut follower, Duration::ZERO, &stop);
        sender.send(Shown::new(1, Topic::Events, Vec::new())).unwrap();
        assert!(matches!(next(), Feed::View(_)) && matches!(next(), Feed::Same));
        stop.store(true, Ordering::Relaxed);
        sender.send(Shown::new(2, Topic::Events, Vec::new())).unwrap();
        assert!(matches!(next(), Feed::Stopped));
        drop(sender);
        assert!(matches!(next(), Feed::Stopped));
        stop.store(false, Ordering::Relaxed);
        assert!(matches!(next(), Feed::View(_)) && matches!(next(), Feed::Ended));
    }
}
