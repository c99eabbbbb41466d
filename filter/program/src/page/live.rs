//! The page that shows a node while it works, or a log.
//!
//! In: what the node publishes, in the messages of the terminal view, and its pictures. Out: one JSON for the page. The node never waits
//! for it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use serde_json::json;
use tactile_data::dataset::touch::Side;
use tactile_eval::narrative::picture;
use tactile_infer::Bank;
use tactile_infer::maps::mosaic::Mosaic;
use tactile_infer::maps::picture::felt;
use tactile_live::camera::Camera;
use tactile_live::event::{Event, Given, Input, Output};
use tactile_live::parameters::CameraParameters;
use tactile_live::session::Onlooker;
use tactile_live::shell::views::Shown;
use tactile_live::watch::Follower;

use super::{Asked, PATIENCE, Reply};

/// Between two pictures that the page may show, ns: a person sees no more.
const PICTURE_NS: i64 = 100_000_000;

/// Pixels of a cell of what was felt.
const CELL_PX: usize = 2;

/// A message of a log, and with a decision the picture of its touch, a data URI.
struct Kept {
    shown: Shown,
    picture: Option<String>,
}

/// What the page shows.
#[derive(Default)]
pub struct LivePage {
    follower: Mutex<Follower>,
    /// All messages so far, where any moment may be asked for.
    kept: Option<Mutex<Vec<Kept>>>,
    /// The latest picture as it came, until it is drawn.
    latest: Mutex<Option<Input>>,
    /// The one that was drawn last, a data URI.
    drawn: Mutex<Option<String>>,
    /// The parts and the side that is touched, where they are known here.
    parts: OnceLock<(Arc<Bank>, Side)>,
    /// What was felt as it was drawn last: of which cells, over which part, a data URI.
    felt: Mutex<(Vec<i8>, Option<String>, Option<String>)>,
}

impl LivePage {
    /// A page that can show any moment: of a log.
    pub fn of_log() -> Self {
        Self { kept: Some(Mutex::default()), ..Self::default() }
    }

    /// Makes the parts of a bank known, whose outlines are then drawn.
    pub fn knows(&self, bank: Arc<Bank>, side: Side) {
        drop(self.parts.set((bank, side)));
    }

    /// Looks at the pictures that come in: keeps the latest, ten a second.
    pub fn pictures(self: &Arc<Self>) -> Onlooker {
        let (page, mut next_ns) = (self.clone(), i64::MIN);
        Box::new(move |event: &Event, _: &[Output]| {
            if matches!(&event.input, Input::Given(given, _) if given.is_picture()) && event.time_ns >= next_ns {
                next_ns = event.time_ns.saturating_add(PICTURE_NS);
                *page.latest.lock().unwrap_or_else(PoisonError::into_inner) = Some(event.input.clone());
            }
        })
    }

    /// Takes in messages until they end or a stop is asked for.
    pub fn follow(&self, receiver: &Receiver<Shown>, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            match receiver.recv_timeout(PATIENCE) {
                Ok(mut shown) => {
                    let picture = shown.picture.take().and_then(|input| draw(&input));
                    let Shown { time_ns, topic, ref cdr, .. } = shown;
                    self.follower.lock().unwrap_or_else(PoisonError::into_inner).take(time_ns, topic, cdr);
                    if picture.is_some() {
                        self.drawn.lock().unwrap_or_else(PoisonError::into_inner).clone_from(&picture);
                    }
                    if let Some(kept) = &self.kept {
                        kept.lock().unwrap_or_else(PoisonError::into_inner).push(Kept { shown, picture });
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }

    /// What a browser asks, answered.
    pub fn answer(&self, asked: &Asked) -> Reply {
        match (asked.path.as_str(), &asked.body) {
            ("", None) => Reply::Text("text/html; charset=utf-8", include_str!("live.html").into()),
            ("page.css", None) => Reply::Text("text/css; charset=utf-8", include_str!("page.css").into()),
            ("live.js", None) => Reply::Text("text/javascript; charset=utf-8", include_str!("live.js").into()),
            ("view", None) => match asked.query.strip_prefix("at=").map(str::parse::<f64>) {
                Some(Ok(at_s)) if at_s.is_finite() => Reply::Text("application/json", self.view(Some(at_s))),
                Some(_) => Reply::Refused("at: expected seconds since the start".into()),
                None => Reply::Text("application/json", self.view(None)),
            },
            _ => Reply::Nowhere,
        }
    }

    /// What there is to draw: now, or of a log so many seconds after its start.
    fn view(&self, at_s: Option<f64>) -> String {
        let now = self.follower.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let end_s = self.kept.as_ref().map(|_| now.view().time_s);
        let then = at_s.and_then(|at_s| self.known_at(at_s));
        let (follower, picture) = then.unwrap_or_else(|| (now, self.picture()));
        let view = json!({
            "view": follower.view(),
            "touched": follower.view().touched(),
            "outline": self.map_of_likeliest(&follower).map(|map| map.outline_mm()),
            "felt": self.felt(&follower),
            "picture": picture,
            "end_s": end_s,
        });
        view.to_string()
    }

    /// What was known at a moment, and the picture of the last touch; `None` where messages are not kept.
    fn known_at(&self, at_s: f64) -> Option<(Follower, Option<String>)> {
        let kept = self.kept.as_ref()?.lock().unwrap_or_else(PoisonError::into_inner);
        let start_ns = kept.first()?.shown.time_ns;
        let (mut follower, mut picture) = (Follower::default(), None);
        for (n, Kept { shown: Shown { time_ns, topic, cdr, .. }, picture: of_touch }) in kept.iter().enumerate() {
            // The first message says when the log begins.
            if n > 0 && (time_ns - start_ns) as f64 * 1e-9 > at_s {
                break;
            }
            follower.take(*time_ns, *topic, cdr);
            picture = of_touch.as_ref().or(picture);
        }
        Some((follower, picture.cloned()))
    }

    /// The map of the likeliest part; nothing where none is known here.
    fn map_of_likeliest(&self, follower: &Follower) -> Option<Mosaic<'_>> {
        let (bank, side) = self.parts.get()?;
        let part = bank
            .parts()
            .iter()
            .position(|name| Some(name) == follower.view().place.as_ref().map(|place| &place.part))?;
        Some(bank.mosaics()?.of(part, *side))
    }

    /// What was felt so far as a data URI; nothing where the node draws no maps.
    fn felt(&self, follower: &Follower) -> Option<String> {
        let part = follower.view().place.as_ref().map(|place| place.part.clone());
        let mut drawn = self.felt.lock().unwrap_or_else(PoisonError::into_inner);
        if (drawn.0.as_slice(), &drawn.1) != (follower.felt(), &part) {
            let frame = felt(follower.felt(), self.map_of_likeliest(follower).as_ref(), CELL_PX);
            let uri = frame.and_then(|frame| picture::frame(&frame).ok());
            *drawn = (follower.felt().to_vec(), part, uri);
        }
        drawn.2.clone()
    }

    /// The latest picture as a data URI; nothing where none came, or none that can be drawn.
    fn picture(&self) -> Option<String> {
        let mut drawn = self.drawn.lock().unwrap_or_else(PoisonError::into_inner);
        let latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(input) = latest {
            *drawn = draw(&input);
        }
        drawn.clone()
    }
}

fn draw(input: &Input) -> Option<String> {
    let mut camera = Camera::new(&CameraParameters::default());
    match input {
        Input::Given(Given::Image, cdr) => camera.image(0, cdr).ok()?,
        Input::Given(Given::CompressedImage, cdr) => camera.compressed(0, cdr).ok()?,
        _ => return None,
    };
    picture::frame(&camera.newest()?.decode().ok()?).ok()
}
