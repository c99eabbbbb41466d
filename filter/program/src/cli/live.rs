//! `tactile-filter live`.

use std::io::stdin;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;

use clap::Args;
use serde_json::{Map, Value};
use tactile_data::file::bounded_file::{self, Kind};
use tactile_data::file::output::check_file;
use tactile_data::light::calibrate::Calibration;
use tactile_data::scene::Scene;
use tactile_infer::Model;
use tactile_live::log::Setup;
use tactile_live::session::{Names, Onlooker, Session};
use tactile_live::shell::speaker::Speaker;
use tactile_live::shell::views::{Shown, terminal};
use tactile_live::shell::watch::{channel, show};
use tactile_live::shell::{Spoken, film, folder, simulated};
use tactile_live::sources::commands::HELP;
use tactile_live::sources::folder::Folder;
use tactile_live::sources::lines::Lines;
use tactile_live::{Error, Node, Parameters};

use super::arguments::{load, warn_of_calibration, warn_of_steps};
use super::failure::Result;
use super::simulated::{SimulatedArgs, summary};
use crate::page::PageServer;
use crate::page::live::LivePage;

/// Identify holes by touches as they are made: frames in, decisions out.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-infer bank --model infer/models/maze-small.safetensors \
                        --scene alphabet-small --xy-step-mm 2 --theta-step-deg 15 --out pegs.bank\n  \
                        tactile-filter live --model infer/models/maze-small.safetensors --bank pegs.bank \
                        --simulate alphabet-small --log live.mcap")]
pub struct Live {
    /// Checkpoint written by tactile-train
    #[arg(long, value_name = "FILE")]
    pub model: PathBuf,
    /// Bank of the pegs that may fit, made by tactile-infer bank with the same model
    #[arg(long, value_name = "FILE")]
    pub bank: PathBuf,
    /// Draw a map of each touch by these networks (`tactile-train --maps`), find each part's place by the bank's map of it
    /// (`tactile-infer bank --maps`) and verify by it that the part is there
    #[arg(long, value_name = "FILE")]
    maps: Option<PathBuf>,
    #[command(flatten)]
    source: Source,
    /// Write all that comes and goes to a new MCAP file, which `replay --log` checks and Foxglove shows
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Print a line of JSON for each touch
    #[arg(long)]
    json: bool,
    /// Show the episode in the terminal instead of printing lines; q ends it
    #[arg(long, conflicts_with_all = ["json", "stdin_mjpeg"])]
    view: bool,
    /// Serve pictures, poses and decisions to Foxglove or Lichtblick at this address, such as 127.0.0.1:8765 (a program
    /// built with `--features foxglove`); filter/live/foxglove-layout.json is a layout for them
    #[arg(long, value_name = "HOST:PORT")]
    foxglove: Option<String>,
    /// Serve a page for browsers at an address such as 127.0.0.1:8766: picture, belief, next touch, what the node reports
    #[arg(long, value_name = "ADDRESS")]
    page: Option<String>,
    /// Parameters in YAML, as ROS 2 has them; several files are read in order; with --ros they are among --ros-args
    #[arg(long, value_name = "FILE", conflicts_with = "ros")]
    params_file: Vec<PathBuf>,
    /// A parameter, such as camera.crop:=border:1/7; with --ros it is among --ros-args
    #[arg(short = 'p', long = "param", value_name = "NAME:=VALUE", conflicts_with = "ros")]
    param: Vec<String>,
    /// With --watch: stop when nothing more is ready
    #[arg(long, conflicts_with_all = ["simulate", "stdin_mjpeg", "ros"])]
    once: bool,
    /// With --stdin-mjpeg: where commands come from, a line each: a file, or a FIFO, which may be opened and closed by one
    /// writer after the other [default: the terminal]
    #[arg(long, value_name = "FILE", conflicts_with_all = ["simulate", "watch", "ros"])]
    commands: Option<PathBuf>,
    /// With --simulate: as fast as it goes, instead of the pace of a clock
    #[arg(long, conflicts_with_all = ["stdin_mjpeg", "watch", "ros"])]
    fast: bool,
    #[command(flatten)]
    simulated: SimulatedArgs,
    /// Words of ROS 2: -r FROM:=TO, -r __ns:=/NAME, -p NAME:=VALUE, --params-file FILE
    #[cfg_attr(not(feature = "ros2"), allow(dead_code, reason = "the flag exists, and says what is missing"))]
    #[arg(long, num_args = 0.., allow_hyphen_values = true, value_terminator = "--", value_name = "WORDS",
          conflicts_with_all = ["simulate", "stdin_mjpeg", "watch"])]
    ros_args: Vec<String>,
}

/// Where touches come from.
#[derive(Args)]
#[group(required = true, multiple = false)]
struct Source {
    /// A simulated robot over the holes of a scene, in this process
    #[arg(long, value_name = "SCENE")]
    simulate: Option<String>,
    /// A film of JPEGs on standard input, and commands from the terminal
    #[arg(long)]
    stdin_mjpeg: bool,
    /// A folder that pictures are put into: rest.png, then NAME.png with NAME.json
    #[arg(long, value_name = "DIR")]
    watch: Option<PathBuf>,
    /// ROS 2 over DDS, without ROS installed (a program built with `--features ros2`)
    #[arg(long)]
    ros: bool,
}

impl Live {
    /// Runs the command.
    pub fn run(mut self) -> Result<()> {
        if let Some(log) = &self.log {
            // Not for as long as the log is written: a log is made new, which only one run can do.
            drop(check_file(log, [&self.model, &self.bank].into_iter().chain(&self.maps))?);
            if log.exists() {
                let expected = "a new file: a log is never written over";
                return Err(Error::invalid(log.display().to_string(), expected, "one that exists").into());
            }
        }
        if self.source.watch.is_some() {
            // Each picture is a touch's only one; what the user sets comes after.
            let stills = ["camera.stills:=true", "camera.n_rest:=1", "camera.reconnect_s:=1e8"].map(str::to_owned);
            self.param.splice(0..0, stills);
        }
        let stop = stop_on_signals()?;
        let (mut onlookers, page) = match &self.page {
            Some(address) => page(address, stop)?,
            None => Default::default(),
        };
        if !self.view {
            let mut speaker = Speaker::new(self.json);
            let looking = Looking { onlookers, page };
            let outcome = self.run_source(looking, stop, &mut |spoken| speaker.tell(&spoken))?;
            outcome.into_iter().for_each(|line| speaker.print(&line));
            return Ok(());
        }
        let (sender, receiver) = channel();
        onlookers.push(terminal(sender));
        let looking = Looking { onlookers, page };
        let node = std::thread::spawn(move || self.run_source(looking, stop, &mut |_| ()));
        let shown = show(&receiver, stop);
        stop.store(true, Ordering::Relaxed);
        let ended = node.join().map_err(|_| Error::invalid("node", "an end", "a panic"))?;
        ended?;
        Ok(shown?)
    }

    /// Feeds a node from the source that was asked for; what a simulated robot's holes came to, in a line.
    fn run_source(self, looking: Looking, stop: &AtomicBool, tell: &mut dyn FnMut(Spoken)) -> Result<Option<String>> {
        if self.source.ros {
            return self.run_ros(looking, stop, tell).map(|()| None);
        }
        let commands = self.source.stdin_mjpeg.then(|| self.lines()).transpose()?;
        let names = Names::default();
        let parameters = self.parameters(&names.node)?;
        let side = parameters.side;
        let session = self.session(&names, parameters, looking)?;
        if let Some(path) = &self.source.watch {
            let folder = Folder::open(path)?;
            folder::run(session, folder, self.once, stop, tell)?;
        } else if let Some(commands) = commands {
            tell(Spoken::Line(HELP.to_owned()));
            film::run(session, stdin(), commands, stop, tell)?;
        } else if let Some(scene) = &self.source.simulate {
            let robot = self.simulated.robot(Scene::load(scene)?, side)?;
            return Ok(Some(summary(&simulated::run(session, robot, !self.fast, stop, tell)?)));
        }
        Ok(None)
    }

    /// Where commands come from.
    fn lines(&self) -> Result<Lines> {
        let path = self.commands.clone().unwrap_or_else(|| "/dev/tty".into());
        Lines::of(&path).map_err(|error| {
            let got = format!("{error}; --commands FILE names another place, such as a FIFO");
            Error::invalid("--commands", format!("commands ({HELP})"), got).into()
        })
    }

    /// The node's parameters: files first, then single ones.
    fn parameters(&self, node: &str) -> Result<Parameters> {
        let mut read = Map::new();
        for path in &self.params_file {
            add_file(&mut read, path, node)?;
        }
        for word in &self.param {
            let wrong = || Error::invalid("-p", "NAME:=VALUE", word.clone());
            let (name, value) = word.split_once(":=").ok_or_else(wrong)?;
            Parameters::set(&mut read, name, value)?;
        }
        let mut parameters = Parameters::of(read)?;
        let camera = &mut parameters.camera;
        if let Some(path) = camera.calibration.as_ref().filter(|path| !path.is_empty()) {
            camera.lamps = Some(Calibration::load(path)?.lamps());
        }
        Ok(parameters)
    }

    fn session(&self, names: &Names, parameters: Parameters, looking: Looking) -> Result<Session> {
        let (model, bank) = load(Model::load(&self.model)?, &self.bank, self.maps.as_deref())?;
        warn_of_calibration(&model, parameters.side);
        warn_of_steps(&bank);
        if let Some(page) = &looking.page {
            page.knows(bank.clone(), parameters.side);
        }
        let setup = names.setup(&parameters, &model, &bank)?;
        let mut session = Session::new(Node::new(parameters, model, bank)?);
        if let Some(address) = &self.foxglove {
            session = session.with_onlooker(foxglove(address, &setup)?);
        }
        let session = looking.onlookers.into_iter().fold(session, Session::with_onlooker);
        match &self.log {
            Some(log) => Ok(session.with_log(log, &setup)?),
            None => Ok(session),
        }
    }

    #[cfg(not(feature = "ros2"))]
    #[allow(clippy::unused_self, reason = "the same as with ROS 2")]
    fn run_ros(self, _: Looking, _: &AtomicBool, _: &mut dyn FnMut(Spoken)) -> Result<()> {
        Err(super::ros::no_ros().into())
    }

    #[cfg(feature = "ros2")]
    fn run_ros(self, looking: Looking, stop: &AtomicBool, tell: &mut dyn FnMut(Spoken)) -> Result<()> {
        use tactile_live::parameters::DISTRIBUTION;
        use tactile_live::ros2::Bus;
        use tactile_live::shell::ros::Network;

        let (words, mut settings) = super::ros::settings("tactile_filter", &self.ros_args)?;
        let node = settings.node.full();
        let mut read = Map::new();
        for path in self.params_file.iter().chain(&words.parameter_files) {
            add_file(&mut read, path, &node)?;
        }
        for parameter in &words.parameters {
            if parameter.node.as_ref().is_none_or(|name| node.ends_with(name.as_str())) {
                Parameters::set(&mut read, &parameter.name, &parameter.value)?;
            }
        }
        if let Some(value) = read.get(DISTRIBUTION) {
            let distribution = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            settings = settings.in_distribution(&distribution).map_err(Error::from)?;
        }
        let parameters = Parameters::of(read)?;
        let (bus, inbox) = Bus::open(settings).map_err(Error::from)?;
        let network = Network::join(bus, inbox)?;
        let names = network.names(&node)?;
        let session = self.session(&names, parameters, looking)?;
        tell(Spoken::Line(format!("{node}: pictures on {}, tool poses on {}", names.image_topic, names.tool_topic)));
        Ok(network.run(session, stop, tell)?)
    }
}

/// Adds the parameters of a file.
fn add_file(read: &mut Map<String, Value>, path: &Path, node: &str) -> Result<()> {
    let text = bounded_file::read_to_string(path, Kind::SETTINGS)?;
    for (name, value) in Parameters::from_yaml(&text, node, &path.display().to_string())? {
        Parameters::set(read, &name, &value.to_string())?;
    }
    Ok(())
}

/// Who looks on while a node works.
struct Looking {
    onlookers: Vec<Onlooker>,
    /// The page, which draws the parts of the bank once it is loaded.
    page: Option<Arc<LivePage>>,
}

/// Serves the page of a node; what looks on for it, and the page.
fn page(address: &str, stop: &'static AtomicBool) -> Result<(Vec<Onlooker>, Option<Arc<LivePage>>)> {
    let (sender, receiver) = channel();
    let shown = serve_page(address, LivePage::default(), receiver, stop)?;
    Ok((vec![terminal(sender), shown.pictures()], Some(shown)))
}

/// Serves a page of what arrives, in threads of its own, and says where.
pub fn serve_page(
    address: &str,
    page: LivePage,
    receiver: Receiver<Shown>,
    stop: &'static AtomicBool,
) -> Result<Arc<LivePage>> {
    let server = PageServer::bind(address)?;
    eprintln!("{}", server.url());
    let shown = Arc::new(page);
    let (following, served) = (shown.clone(), shown.clone());
    std::thread::spawn(move || following.follow(&receiver, stop));
    std::thread::spawn(move || server.serve(stop, &|asked| served.answer(&asked)));
    Ok(shown)
}

#[cfg(feature = "foxglove")]
fn foxglove(address: &str, setup: &Setup) -> Result<Onlooker> {
    Ok(tactile_live::shell::views::foxglove(address, setup.clone())?)
}

/// What is said where the program knows no Foxglove.
#[cfg(not(feature = "foxglove"))]
fn foxglove(_: &str, _: &Setup) -> Result<Onlooker> {
    let how = "cargo build --release -p tactile-filter-cli --features foxglove";
    Err(Error::invalid("Foxglove", format!("a program built with it ({how})"), "one without").into())
}

/// Whether the node should end.
static STOP: AtomicBool = AtomicBool::new(false);

/// Set at ctrl-C, and where the program is asked to end or its terminal is closed (SIGTERM, SIGHUP), so that a log gets
/// its end and a terminal is given back.
pub fn stop_on_signals() -> Result<&'static AtomicBool> {
    ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed))
        .map_err(|error| Error::invalid("signals", "a handler", error.to_string()))?;
    Ok(&STOP)
}
