//! `tactile-filter assemble`.

use std::sync::Arc;

use clap::Args;
use tactile_data::dataset::touch::Side;
use tactile_data::file::output;
use tactile_data::program::progress::reporter;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::Simulator;
use tactile_eval::assembly::{Assembly, Group, Insertion, Run, Task, Workcell, html, trial};
use tactile_eval::fits::check_bank;
use tactile_eval::holes::Holes;
use tactile_eval::narrative::Board;
use tactile_eval::result::{ModelRecord, Poses};
use tactile_eval::{Error, Result};
use tactile_filter::EpisodeConfig;
use tactile_infer::{Bank, Model};

use super::arguments::{Engine, Inputs, Output, Seeds, SensorArgs, SpeedArgs, command_line, to_json, warn_of_poses};
use super::numbers::Numbers;

/// Names of the page and of the figures.
const FILES: [&str; 2] = ["report.html", "assembly.json"];

/// The place that a search begins from is known to this standard deviation along x and along y, mm: to 0.5, 1 or 2 takes equally long.
const SEARCHED_MM: f64 = 0.5;

/// Name, find and fill every hole of a scene in simulation; write assembly.json and report.html.
///
/// A peg is tried once the place is known to 0.5 mm along x and along y (a standard deviation), straight down (--search 1) to a
/// quarter of the scene's clearance_mm (--set stop_place_mm=MM). Friction and force are not simulated; with --set false_refuse=0.01 a hole may be given up as none of the pegs on the table. Memory is linear in the parts, as that of evaluate.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-filter assemble --model infer/models/maze-small.safetensors \
                        --bank four.bank --scene data/scenes/four-letters.toml --out assembly")]
pub struct Assemble {
    #[command(flatten)]
    inputs: Inputs,
    #[command(flatten)]
    sensor: SensorArgs,
    /// Scene whose holes are filled: the name of a preset, or a TOML file; its clearance_mm is the play of a peg
    #[arg(long, value_name = "PRESET|FILE.toml")]
    scene: String,
    #[command(flatten)]
    output: Output,
    /// Trials in all, shared out over the seeds; in each all holes are tried in turn
    #[arg(long, value_name = "N", default_value_t = 200, help_heading = "Trials")]
    trials: usize,
    #[command(flatten, next_help_heading = "Trials")]
    seeds: Seeds,
    /// A held peg is off by up to this in x and in y, mm, and turned by up to this, degrees
    #[arg(long, value_names = ["MM", "DEG"], allow_negative_numbers = true, default_values_t = [0.5, 1.0], help_heading = "Trials")]
    grasp_error: Vec<f64>,
    /// The plate of a hole is tilted against the tool by this, towards any side, degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.0, help_heading = "Trials")]
    tilt: f64,
    /// Press a held peg on a second sensor so often before it is tried, so that its place in the hand is known
    #[arg(long, value_name = "N", default_value_t = Insertion::default().peg_touches, help_heading = "Insertion")]
    peg_touches: usize,
    /// Slide a peg over so many poses at most until it goes in, the likeliest first; 1: straight down
    #[arg(long, value_name = "N", default_value_t = Insertion::default().search_poses, help_heading = "Insertion")]
    search: usize,
    /// Try a hole so often; a peg that does not go in is evidence, and the hole is touched again before the next try
    #[arg(long, value_name = "N", default_value_t = Insertion::default().tries, help_heading = "Insertion")]
    tries: usize,
    /// Speed of a peg along the plate, mm a second
    #[arg(long, value_name = "MM", default_value_t = Insertion::default().slide_mm_s, help_heading = "Insertion")]
    slide_mm_s: f64,
    #[command(flatten)]
    speeds: SpeedArgs,
    #[command(flatten)]
    numbers: Numbers,
}

impl Assemble {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let (model, bank) = self.inputs.load()?;
        let simulator = Simulator::new(Scene::load(&self.scene)?, 1)?;
        let holes = Holes::Simulated(&simulator, Side::Hole);
        let sensor = holes.sensor(&model, &holes.at_rest(&self.seeds.seeds))?;
        let config = self.config(&simulator, &model, &bank)?;
        let task = self.task(&simulator)?;
        let workcell = Workcell::new(&simulator, &sensor, &bank, &config, &task)?;
        let _locks = self.output.prepare(FILES[0], FILES[1], &self.inputs.files(&self.scene))?;
        check_bank(&bank, simulator.scene(), self.sensor.other_sensor)?;
        warn_of_poses(holes, &bank, Poses::OffGrid);

        let trials = workcell.run(&reporter("trials"))?;
        let run = Run {
            scene: simulator.scene().name.clone(),
            clearance_mm: simulator.scene().clearance_mm,
            model: ModelRecord::of(&model),
            device: self.inputs.device.to_string(),
            recorded: *bank.start(),
            command: Some(command_line()),
        };
        let assembly = Assembly::of(run, &task, simulator.parts(), &trials);
        let page = html(
            &assembly,
            &Board::new(Holes::Simulated(&simulator, Side::Hole), &bank)?,
            &trial::play_again(&workcell, 0)?,
        )?;
        let page = self.output.write(FILES[0], &page)?;
        let json = to_json("assembly", &assembly)?;
        // Last: whoever finds the figures finds the report too.
        self.output.write(FILES[1], &json)?;
        self.output.print(&json, &page, || print_table(&assembly));
        Ok(())
    }

    fn config(&self, simulator: &Simulator, model: &Arc<Model>, bank: &Bank) -> Result<EpisodeConfig> {
        self.numbers.refuse(&["seed"], "--seeds, from which each trial has its own", "one")?;
        self.numbers.check_engines(&[Engine::Exact])?;
        let of_model = EpisodeConfig::of_side(model, Side::Hole).changed(|settings, model, _| {
            // Every hole's peg is on the table: a bad fit asks for another touch, not for giving up.
            settings.false_refuse = 0.0;
            // Straight down two standard deviations are half of the play; where the peg is slid, less will do.
            let straight = simulator.scene().clearance_mm / 4.0;
            let by_play = if self.search > 1 { straight.max(SEARCHED_MM) } else { straight };
            settings.stop_place_mm = model.interpolation.is_cubic(bank.grid()).then_some(by_play);
        });
        self.numbers.applied_to(of_model)
    }

    fn task(&self, simulator: &Simulator) -> Result<Task> {
        /// What is noted of a hole: part, touches, errors, the time of each decision.
        const HOLE_BYTES: f64 = 256.0;
        let n_bytes = self.trials as f64 * simulator.parts().len() as f64 * HOLE_BYTES;
        output::check_memory("--trials", self.trials, n_bytes)?;
        let [grasp_error_mm, grasp_error_deg] = self.grasp_error[..] else {
            return Err(Error::invalid(
                "--grasp-error",
                "two numbers, mm and degrees",
                self.grasp_error.len().to_string(),
            ));
        };
        let Self { trials, tilt, peg_touches, search, tries, slide_mm_s, .. } = *self;
        Ok(Task {
            n_trials: trials,
            seeds: self.seeds.seeds.clone(),
            grasp_error_mm,
            grasp_error_deg,
            tilt_deg: tilt,
            insertion: Insertion { peg_touches, search_poses: search, tries, slide_mm_s },
            speeds: self.speeds.speeds(),
        })
    }
}

fn print_table(assembly: &Assembly) {
    let Assembly { run, all_inserted, holes, .. } = assembly;
    println!(
        "{}: {} trials of {} holes; a hole is {} mm wider on every side and tilted by {} degrees, a held peg up to {} mm and {} degrees off",
        run.scene,
        assembly.n_trials,
        assembly.parts.len(),
        run.clearance_mm,
        assembly.tilt_deg,
        assembly.grasp_error_mm,
        assembly.grasp_error_deg
    );
    let [low, high] = all_inserted.ci95.map(|bound| 100.0 * bound);
    let (n, of, share) = (all_inserted.n, all_inserted.of, 100.0 * all_inserted.share);
    println!("  every peg in its hole: {n} of {of} trials, {share:.1} % ({low:.1} to {high:.1})");
    println!(
        "  {:16} {:>5} {:>8} {:>15} {:>7} {:>6} {:>6} {:>7} {:>7} {:>11} {:>10}",
        "holes", "n", "own in %", "95 % interval", "touches", "tries", "s", "mm", "degrees", "wrong place", "wrong peg"
    );
    let print = |what: &str, group: &Group| {
        let [low, high] = group.inserted.ci95.map(|bound| 100.0 * bound);
        println!(
            "  {:16} {:5} {:8.1} {low:7.1}-{high:<7.1} {:7.2} {:6.2} {:6.1} {:7.2} {:7.2} {:11} {:10}",
            format!("{what}{}", group.name),
            group.inserted.of,
            100.0 * group.inserted.share,
            group.touches_mean,
            group.tries_mean,
            group.seconds_mean,
            group.xy_mm_mean,
            group.theta_deg_mean,
            group.wrong_pose,
            group.wrong_part
        );
    };
    print("", holes);
    assembly.parts.iter().for_each(|group| print("", group));
    assembly.stops.iter().for_each(|group| print("", group));
    assembly.pegs_left.iter().for_each(|group| print("pegs left: ", group));
    let went_in = holes.wrong_part_went_in;
    println!(
        "  wrong pegs that went in: {went_in}; median error {:.2} mm, {:.2} degrees",
        holes.xy_mm_median, holes.theta_deg_median
    );
    println!("  ms from frame to decision, p50/p99: {:.1}/{:.1}", assembly.decision_ms.p50, assembly.decision_ms.p99);
}
