//! `tactile-filter assemble`.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use tactile_data::scene::Scene;
use tactile_data::simulator::Simulator;
use tactile_eval::assembly::{Assembly, Group, Run, Task, Workcell, html};
use tactile_eval::evaluate::at_rest;
use tactile_eval::narrative::{Board, trial};
use tactile_eval::page::shell::{check_page, write_page};
use tactile_eval::result::ModelRecord;
use tactile_eval::{Error, Result};
use tactile_filter::Sensor;
use tactile_filter::action::ActionRule;
use tactile_infer::Bank;
use tactile_infer::safefile::write_whole;
use tactile_infer::{DeviceKind, Model};

use super::evaluate::{command_line, progress};
use super::tuning::Tuning;

/// Name, find and fill every hole of a scene in simulation; write assembly.json and report.html.
#[derive(Args)]
#[command(
    after_help = "Example:\n  tactile-filter assemble --model infer/models/maze-small.safetensors --bank four.bank --scene data/scenes/four-letters.toml --out assembly"
)]
pub struct Assemble {
    /// Checkpoint written by tactile-train.
    #[arg(long)]
    model: PathBuf,
    /// Bank of the scene's pegs, made by tactile-infer bank with the same model.
    #[arg(long)]
    bank: PathBuf,
    /// Scene preset or TOML file whose holes are filled; its clearance_mm is the play of a peg.
    #[arg(long)]
    scene: String,
    /// Folder for assembly.json and report.html.
    #[arg(long)]
    out: PathBuf,
    /// Trials in all, shared out over the seeds; in each all holes are tried in turn.
    #[arg(long, default_value_t = 200)]
    trials: usize,
    /// Seeds of the holes' order, of first touches, frames and grasps.
    #[arg(long, value_delimiter = ',', default_value = "1,2,3")]
    seeds: Vec<u64>,
    /// A held peg is off by up to this in x and in y, mm.
    #[arg(long, default_value_t = 0.5)]
    grasp_error_mm: f64,
    /// A held peg is turned by up to this, degrees.
    #[arg(long, default_value_t = 1.0)]
    grasp_error_deg: f64,
    /// How well the place must be known before a peg is tried, mm: the standard deviation along x and along y
    /// [default: half the scene's clearance_mm].
    #[arg(long)]
    place_mm: Option<f64>,
    /// Let the robot give up a hole as none of the pegs on the table, though each has its peg there.
    #[arg(long)]
    strangers: bool,
    /// Where the network is computed: flex or ndarray.
    #[arg(long, default_value = "flex", value_parser = clap::builder::PossibleValuesParser::new(DeviceKind::NAMES))]
    device: String,
    /// Print assembly.json instead of a table.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    tuning: Tuning,
}

impl Assemble {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let page = self.out.join("report.html");
        check_page(&page)?;
        let model = Arc::new(Model::load_on(&self.model, self.device.parse()?)?);
        let bank = Arc::new(Bank::load(&self.bank, &model)?);
        let simulator = Simulator::new(Scene::load(&self.scene)?, 1)?;
        let no_contact = at_rest(&simulator, &self.seeds);
        let sensor = Sensor::new(model.clone(), &no_contact)?;
        let mut config = self.tuning.config("exact", ActionRule::Information, &model)?;
        if !self.strangers {
            // Every hole's peg is on the table: a bad fit asks for another touch, not for giving up.
            config.none_touches = config.max_touches + 1;
        }
        config.stop_place_mm = Some(self.place_mm.unwrap_or(0.5 * simulator.scene().clearance_mm));
        let (n_trials, seeds) = (self.trials, self.seeds.clone());
        let (grasp_error_mm, grasp_error_deg) = (self.grasp_error_mm, self.grasp_error_deg);
        let task = Task { n_trials, seeds, grasp_error_mm, grasp_error_deg };
        let workcell = Workcell::new(&simulator, &sensor, &bank, &config, &task)?;

        let bar = progress("assembly");
        let trials = workcell.run(&|done, total| {
            bar.set_length(total as u64);
            bar.set_position(done as u64);
        })?;
        bar.finish_and_clear();
        let run = Run {
            scene: simulator.scene().name.clone(),
            clearance_mm: simulator.scene().clearance_mm,
            model: ModelRecord::of(&model),
            device: self.device.clone(),
            recorded: *bank.grid(),
            command: Some(command_line()),
        };
        let assembly = Assembly::of(run, &task, simulator.parts(), &trials);
        let episodes = trial::play_again(&workcell, 0)?;
        write_page(&page, &html(&assembly, &Board::new(&simulator, &bank)?, &episodes)?)?;
        let json =
            serde_json::to_string_pretty(&assembly).map_err(|e| Error::invalid("assembly", "JSON", e.to_string()))?;
        // Last: whoever finds the figures finds the report too.
        write_whole(&self.out.join("assembly.json"), json.as_bytes())?;
        if self.json {
            println!("{json}");
        } else {
            print_table(&assembly);
            println!("  {}", page.display());
        }
        Ok(())
    }
}

fn print_table(assembly: &Assembly) {
    let Assembly { run, all_inserted, holes, .. } = assembly;
    println!(
        "{}: {} trials of {} holes; a hole is {} mm wider on every side, a held peg up to {} mm and {} degrees off",
        run.scene,
        assembly.n_trials,
        assembly.parts.len(),
        run.clearance_mm,
        assembly.grasp_error_mm,
        assembly.grasp_error_deg
    );
    let [low, high] = all_inserted.ci95.map(|bound| 100.0 * bound);
    let (n, of, share) = (all_inserted.n, all_inserted.of, 100.0 * all_inserted.share);
    println!("  every peg in its hole: {n} of {of} trials, {share:.1} % ({low:.1} to {high:.1})");
    println!(
        "  {:16} {:>5} {:>8} {:>15} {:>7} {:>6} {:>7} {:>7} {:>11} {:>10}",
        "holes", "n", "own in %", "95 % interval", "touches", "median", "mm", "degrees", "wrong place", "wrong peg"
    );
    let print = |what: &str, group: &Group| {
        let [low, high] = group.inserted.ci95.map(|bound| 100.0 * bound);
        println!(
            "  {:16} {:5} {:8.1} {low:7.1}-{high:<7.1} {:7.2} {:6} {:7.2} {:7.2} {:11} {:10}",
            format!("{what}{}", group.name),
            group.inserted.of,
            100.0 * group.inserted.share,
            group.touches_mean,
            group.touches_median,
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
