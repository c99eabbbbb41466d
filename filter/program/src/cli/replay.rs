//! `tactile-filter replay`.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use tactile_data::dataset::store::{Dataset, FILES};
use tactile_data::file::output::prepare_file;
use tactile_data::frame::picture;
use tactile_data::light::touch_light::SensorLight;
use tactile_data::program;
use tactile_data::text::printable::printable_json;
use tactile_eval::Error;
use tactile_eval::fits::warn_of_played;
use tactile_eval::replay::{Replayed, episodes, play};
use tactile_filter::budget::Speeds;
use tactile_filter::{Sensor, StopReason};
use tactile_infer::maps::mosaic::Difference;
use tactile_infer::{Bank, Model};
use tactile_live::replay;
use tactile_live::shell::Spoken;
use tactile_live::shell::speaker::Speaker;

use super::arguments::{Engine, Inputs, SideArgs, warn_of_calibration, warn_of_light};
use super::budget::{BudgetArgs, Task};
use super::failure::Result;
use super::label::LabelledTouches;
use super::learn::LearntParts;
use super::numbers::Numbers;

/// Play a recorded dataset of touches, or the log of a live node, back through the filter.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-data import presses --out recorded\n  \
                        tactile-filter replay --model infer/models/maze-small.safetensors --bank pegs.bank \
                        --data recorded")]
pub struct Replay {
    #[command(flatten)]
    inputs: Inputs,
    /// Recorded dataset: imported, or generated with its holes
    #[arg(long, value_name = "DIR", required_unless_present = "log")]
    data: Option<PathBuf>,
    /// Log of `live --log` instead: its events are given to a new node, and all that it says is compared byte for byte
    #[arg(long, value_name = "FILE", conflicts_with_all = [
        "data", "side", "limit", "engine", "learn_light", "BudgetArgs", "Numbers",
    ])]
    log: Option<PathBuf>,
    #[command(flatten)]
    which: SideArgs,
    /// Play at most this many episodes [default: all]
    #[arg(long, value_name = "N")]
    limit: Option<usize>,
    /// How states are inferred
    #[arg(long, value_enum, conflicts_with = "budget", default_value_t = Engine::Exact)]
    engine: Engine,
    /// The recording's lamps are not known: its touches tell them, from the first 20 that show edges on
    #[arg(long)]
    learn_light: bool,
    /// Print a line of JSON for each episode
    #[arg(long)]
    json: bool,
    /// With --maps: a picture of what each episode felt, episode-N.png: blue inside of what was touched, red outside; the outline of
    /// the named part is green, and what differs from it yellow
    #[arg(long, value_name = "DIR", requires = "maps", conflicts_with = "log")]
    felt: Option<PathBuf>,
    /// With --maps: what episodes felt that end as none of these become new parts of --scene, DIR/scene.toml: make a bank of it, and they
    /// are known
    #[arg(long, value_name = "DIR", requires_all = ["maps", "scene"], conflicts_with = "log")]
    learn: Option<PathBuf>,
    /// Touches of the parts that are named become a dataset with their parts and poses, whether or not they match: `tactile-data
    /// calibrate --touches DIR --scene` then finds the sensor's gel. Record parts that the bank has
    #[arg(long, value_name = "DIR", conflicts_with = "log")]
    label: Option<PathBuf>,
    /// With --learn: the scene that the bank was made of
    #[arg(long, value_name = "SCENE", requires = "learn")]
    scene: Option<String>,
    #[command(flatten)]
    budget: BudgetArgs,
    #[command(flatten)]
    numbers: Numbers,
}

/// Pixels of a cell of 0.3 mm of what was felt.
const CELL_PX: usize = 3;

/// Scales that differ by more than this share are reported: an edge's shape then means another thing.
const SCALE_TOLERANCE: f64 = 0.05;

/// What is known of the lamps of a recording that does not say which they are.
fn light_of(dataset: &Dataset) -> Result<SensorLight> {
    let meta = dataset.meta();
    if meta.lamps.is_some() {
        return Err(Error::invalid("--learn-light", "a recording whose lamps are not known", &*meta.name).into());
    }
    Ok(SensorLight::new(dataset.no_contact(), meta.field_of_view_mm())?)
}

/// The sensor under the lamps that one more episode's touches tell.
fn relit(sensor: Sensor, light: &mut SensorLight, dataset: &Dataset, replayed: &Replayed) -> Result<Sensor> {
    if !light.learns() {
        return Ok(sensor);
    }
    replayed.frames.iter().try_for_each(|frame| light.add(&dataset.frame(*frame)))?;
    let Some(found) = light.learn() else { return Ok(sensor) };
    program::note(format_args!("light: {}", found.line()));
    Ok(sensor.lit_by(light.lamps())?)
}

impl Replay {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        self.budget.check_chosen(&[], &self.numbers)?;
        self.numbers.check_no_choice()?;
        self.numbers.check_engines(&[self.engine])?;
        let (model, mut bank) = self.inputs.load()?;
        let Some(data) = &self.data else { return self.replay_log(model, bank) };
        let dataset = Dataset::open(data)?;
        self.warn_of_scale(&model, &dataset);
        let side = self.which.side;
        warn_of_calibration(&model, side);
        let lamps = dataset.meta().lamps.as_ref();
        warn_of_light(&bank, lamps);
        let mut sensor = Sensor::new(model.clone(), dataset.no_contact())?.of_side(side).lit_by(lamps)?;
        let mut light = self.learn_light.then(|| light_of(&dataset)).transpose()?;
        let mut config = self.numbers.applied_to(self.engine.config(&model, side))?;
        if self.budget.is_given() {
            let (model_path, model, no_contact) = (self.inputs.model.as_path(), &model, dataset.no_contact());
            let (reach, between_poses) = (*bank.start(), config.method().between_poses);
            let speeds = Speeds::default();
            let task = Task { model_path, model, bank: &bank, no_contact, reach, between_poses, speeds };
            (bank, config, _) = self.budget.choose(&task, &config)?;
        }
        let recorded = episodes(&dataset, side)?;
        let limit = self.limit.unwrap_or(recorded.len());
        let learnt = self.learn.as_ref().zip(self.scene.as_ref());
        let mut learnt = learnt.map(|(folder, scene)| LearntParts::new(folder, scene)).transpose()?;
        let label = |folder: &PathBuf| LabelledTouches::new(folder, &dataset, side);
        let mut labelled = self.label.as_ref().map(label).transpose()?;
        let feels_all = learnt.is_some() || labelled.is_some();
        let mut n_right = [0, 0];
        for (number, touches) in recorded.iter().take(limit).enumerate() {
            let replayed = play((&dataset, touches), &sensor, &bank, &config, feels_all)?;
            if let Some(truth) = &replayed.truth {
                n_right[0] += usize::from(*truth == replayed.part);
                n_right[1] += 1;
            }
            self.print(number, &replayed)?;
            self.draw(number, &replayed, &bank)?;
            let felt = replayed.felt_map.as_ref().filter(|_| replayed.stop == Some(StopReason::NoneOfThese));
            if let Some((learnt, felt)) = learnt.as_mut().zip(felt) {
                learnt.add(number, felt, &replayed.episode)?;
            }
            if let Some(labelled) = &mut labelled {
                labelled.add(number, touches, &replayed.episode)?;
            }
            if let Some(light) = &mut light {
                sensor = relit(sensor, light, &dataset, &replayed)?;
            }
        }
        learnt.iter().try_for_each(LearntParts::finish)?;
        labelled.map_or(Ok(()), LabelledTouches::finish)?;
        // Said last: what goes wrong is one line.
        if let Some(why) = warn_of_played(&dataset, side, &bank) {
            program::warning(why);
        }
        if recorded.is_empty() {
            program::say(format_args!("no touch: no frame of {} shows contact", data.display()));
        } else if n_right[1] > 0 && !self.json {
            println!("{} of {} episodes named right", n_right[0], n_right[1]);
        }
        Ok(())
    }

    /// A picture of what an episode felt.
    fn draw(&self, number: usize, replayed: &Replayed, bank: &Bank) -> Result<()> {
        let (Some(folder), Some(felt_map)) = (&self.felt, &replayed.felt_map) else { return Ok(()) };
        let path = folder.join(format!("episode-{number}.png"));
        let inputs = self.data.iter().flat_map(|data| FILES.map(|file| data.join(file)));
        let _lock = prepare_file(&path, inputs)?;
        picture::write_png(&path, &felt_map.picture(bank, CELL_PX)?)?;
        Ok(())
    }

    fn replay_log(&self, model: Arc<Model>, bank: Arc<Bank>) -> Result<()> {
        let Some(log) = &self.log else { return Ok(()) };
        let replayed = replay::replay(log, model, bank)?;
        let mut speaker = Speaker::new(self.json);
        for decision in &replayed.decisions {
            speaker.tell(&Spoken::Decision(Box::new(decision.clone())));
        }
        if let Some(cut) = &replayed.cut {
            program::warning(cut);
        }
        eprintln!("{} events give the same {} decisions again", replayed.n_events, replayed.decisions.len());
        Ok(())
    }

    fn warn_of_scale(&self, model: &Model, dataset: &Dataset) {
        let meta = dataset.meta();
        let view = meta.field_of_view_mm();
        let trained = model.preprocessing().field_of_view_mm;
        if (0..2).any(|axis| (view[axis] / trained[axis] - 1.0).abs() > SCALE_TOLERANCE) {
            program::warning(format_args!(
                "{} shows {:.1} x {:.1} mm, the model was trained on {:.1} x {:.1} mm",
                dataset.meta().name,
                view[0],
                view[1],
                trained[0],
                trained[1]
            ));
        }
    }

    fn print(&self, number: usize, replayed: &Replayed) -> Result<()> {
        if self.json {
            let line = serde_json::to_string(replayed).map_err(|e| Error::invalid("result", "JSON", e.to_string()))?;
            println!("{}", printable_json(&line));
            return Ok(());
        }
        let [x, y, theta] = replayed.part_from_sensor;
        let truth = replayed.truth.as_ref().map_or(String::new(), |part| format!(", truth {part}"));
        let twins = match replayed.symmetry_order {
            None => " or at any angle".to_string(),
            Some(1) => String::new(),
            Some(order) => format!(" or turned by {:.0} deg", 360.0 / order as f64),
        };
        let or = match &replayed.or {
            Some((part, probability)) => format!(" or {part} with {:.1} %", 100.0 * probability),
            None => String::new(),
        };
        let how = match replayed.stop {
            _ if replayed.confident => "surely",
            Some(StopReason::NoneOfThese) => "none of these, nearest",
            _ => "perhaps",
        };
        program::say(format_args!(
            "episode {number}: {} touches, {how} {} with {:.1} %{or}, x {x:.1} mm, y {y:.1} mm, theta {theta:.0} deg{twins}{truth}",
            replayed.frames.len(),
            replayed.part,
            100.0 * replayed.probability
        ));
        if let (false, Some(rate)) = (replayed.confident, replayed.stranger_rate) {
            program::say(format_args!(
                "  a stranger feels as much like a part in {:.1} % of its episodes",
                100.0 * rate
            ));
        }
        if let Some(Difference { seen_mm2, only_first_mm2, only_second_mm2 }) = replayed.difference {
            program::say(format_args!(
                "  of {seen_mm2:.0} mm2 felt, {only_first_mm2:.0} are inside here and outside of {0}, {only_second_mm2:.0} the other way round",
                replayed.part
            ));
        }
        for warning in &replayed.warnings {
            program::say(format_args!("  warning: {warning}"));
        }
        Ok(())
    }
}
