//! `tactile-filter try`.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use clap::Args;
use serde::Deserialize;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::program::progress::reporter;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::Simulator;
use tactile_eval::by_hand::ByHand;
use tactile_filter::{EpisodeConfig, Sensor};
use tactile_infer::bank::learn_from::LearnFrom;
use tactile_infer::bank::simulated::SceneBank;
use tactile_infer::bank::simulated::mosaics::with_maps_of_scene;
use tactile_infer::maps::Maps;
use tactile_infer::{Bank, Model, Views};

use super::failure::Result;
use super::live::stop_on_signals;
use crate::page::{Asked, PageServer, Reply};

/// A bank that is interpolated between its poses: mm and degrees.
const STEPS: [f64; 2] = [2.0, 15.0];

/// Touch a simulated hole by hand, in a browser: click where to press, see what the sensor sees and what the filter believes.
///
/// Makes the bank of the scene first, which takes seconds. Serves one page on this machine until Ctrl-C.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-filter try --scene alphabet-small")]
pub struct Try {
    /// Scene whose holes are touched: the name of a preset, or a TOML file
    #[arg(long, value_name = "PRESET|FILE.toml", default_value = "alphabet-small")]
    scene: String,
    /// The model
    #[arg(long, value_name = "FILE", default_value = "infer/models/maze-small.safetensors")]
    model: PathBuf,
    /// Networks that draw maps of touches: what was felt so far is shown, and parts are named by it, too [default: MODEL with
    /// the ending .maps.safetensors, where it is]
    #[arg(long, value_name = "FILE")]
    maps: Option<PathBuf>,
    /// A bank of the scene's parts [default: it is made]
    #[arg(long, value_name = "FILE")]
    bank: Option<PathBuf>,
    /// Where the page is served; port 0 takes a free one
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8765")]
    page: String,
    /// Seed of the holes and of the pictures
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// A pose as the page sends it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Press {
    x_mm: f64,
    y_mm: f64,
    theta_deg: f64,
}

impl Try {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let server = PageServer::bind(&self.page)?;
        let by_hand = Mutex::new(self.by_hand()?);
        let stop = stop_on_signals()?;
        eprintln!("{}  (Ctrl-C stops it)", server.url());
        server.serve(stop, &|asked| answer(&by_hand, &asked));
        Ok(())
    }

    fn by_hand(&self) -> Result<ByHand> {
        let shipped = Some(self.model.with_extension("maps.safetensors")).filter(|path| path.exists());
        let maps = self.maps.clone().or(shipped).map(|path| Maps::load(&path)).transpose()?;
        let model = Model::load(&self.model)?;
        let model = Arc::new(match &maps {
            Some(maps) => model.with_maps(maps.clone())?,
            None => model,
        });
        let mut scene = Scene::load(&self.scene)?;
        let bank = match (&self.bank, &maps) {
            (Some(path), _) => Bank::load(path, &model)?,
            (None, maps) => {
                let [xy_step_mm, theta_step_deg] = STEPS;
                let mut of_bank = scene.clone();
                of_bank.reach = of_bank.reach.map(|reach| PoseGrid { xy_step_mm, theta_step_deg, ..reach });
                let (views, learn_from) = (Views::Both, LearnFrom::Hole);
                let made = SceneBank { model: &model, scene: &of_bank, views, learn_from, seed: self.seed };
                let bank = made.make(None, &reporter("touches of the bank"))?;
                match maps {
                    Some(maps) => {
                        with_maps_of_scene(bank, maps, (&of_bank, views), self.seed, &reporter("touches of its maps"))?
                    }
                    None => bank,
                }
            }
        };
        scene.reach = Some(*bank.start());
        let simulator = Simulator::new(scene, self.seed)?;
        let sensor = Sensor::new(model.clone(), &simulator.no_contact(self.seed))?;
        Ok(ByHand::new(simulator, sensor, Arc::new(bank), EpisodeConfig::of(&model), self.seed)?)
    }
}

/// What the page asks, answered.
fn answer(by_hand: &Mutex<ByHand>, asked: &Asked) -> Reply {
    let mut by_hand = by_hand.lock().unwrap_or_else(PoisonError::into_inner);
    let changed = match (asked.path.as_str(), &asked.body) {
        ("", None) => return Reply::Text("text/html; charset=utf-8", include_str!("../page/page.html").into()),
        ("page.css", None) => return Reply::Text("text/css; charset=utf-8", include_str!("../page/page.css").into()),
        ("page.js", None) => {
            return Reply::Text("text/javascript; charset=utf-8", include_str!("../page/page.js").into());
        }
        ("state", None) => Ok(()),
        ("renew", Some(_)) => {
            by_hand.renew();
            Ok(())
        }
        ("show", Some(_)) => {
            by_hand.show();
            Ok(())
        }
        ("touch", Some(body)) => match serde_json::from_str(body) {
            Ok(Press { x_mm, y_mm, theta_deg }) => by_hand.touch(Se2::from_degrees(x_mm, y_mm, theta_deg)),
            Err(error) => return Reply::Refused(format!("touch: expected a pose, got {error}")),
        },
        _ => return Reply::Nowhere,
    };
    let state = changed.and_then(|()| by_hand.state());
    let text = state.map(|state| serde_json::to_string(&state).map_err(|error| error.to_string()));
    match text {
        Ok(Ok(text)) => Reply::Text("application/json", text),
        Ok(Err(why)) => Reply::Refused(why),
        Err(error) => Reply::Refused(error.to_string()),
    }
}
