//! `tactile-filter watch`.

use std::path::PathBuf;
use std::sync::atomic::Ordering;

use clap::Args;
use tactile_infer::{Bank, Model};
use tactile_live::Error;
use tactile_live::log::Setup;
use tactile_live::shell::watch::{channel, follow_log, show};

use super::failure::Result;
use super::live::{serve_page, stop_on_signals};
use crate::page::PATIENCE;
use crate::page::live::LivePage;

/// Look at a running node, or at a log, in the terminal.
#[derive(Args)]
#[command(
    after_help = "Examples:\n  tactile-filter watch --log live.mcap\n  tactile-filter watch --log live.mcap --pace 1\n  \
                        tactile-filter watch --log live.mcap --page 127.0.0.1:8766 --model m.safetensors --bank pegs.bank\n  \
                        tactile-filter watch --ros\n\nKeys: q leaves; the arrows choose the part whose map is shown; \
                        Home follows the likeliest."
)]
pub struct Watch {
    /// Log of `live --log`, while it grows or later
    #[arg(long, value_name = "FILE", required_unless_present = "ros", conflicts_with = "ros")]
    log: Option<PathBuf>,
    /// Play the log so many times as fast as it was recorded, instead of showing what is there at once
    #[arg(long, value_name = "FACTOR", conflicts_with = "ros")]
    pace: Option<f64>,
    /// Serve a page for browsers at an address such as 127.0.0.1:8766 instead of the terminal view, until Ctrl-C
    #[arg(long, value_name = "ADDRESS")]
    page: Option<String>,
    /// With --page: the bank that the log is of; the outline of the likeliest part is then drawn
    #[arg(long, value_name = "FILE", requires_all = ["page", "log", "model"])]
    bank: Option<PathBuf>,
    /// With --bank: its model
    #[arg(long, value_name = "FILE", requires = "bank")]
    model: Option<PathBuf>,
    /// The node on a ROS 2 network (a program built with `--features ros2`)
    #[arg(long)]
    ros: bool,
    /// Full name of the node
    #[arg(long, value_name = "NAME", default_value = "/tactile_filter", conflicts_with = "log")]
    #[cfg_attr(not(feature = "ros2"), allow(dead_code, reason = "the flag exists, and --ros says what is missing"))]
    node: String,
    /// Words of ROS 2
    #[arg(long, num_args = 0.., allow_hyphen_values = true, value_terminator = "--", value_name = "WORDS", conflicts_with = "log")]
    #[cfg_attr(not(feature = "ros2"), allow(dead_code, reason = "the flag exists, and --ros says what is missing"))]
    ros_args: Vec<String>,
}

impl Watch {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let (sender, receiver) = channel();
        if let Some(pace) = self.pace.filter(|pace| !(pace.is_finite() && *pace > 0.0)) {
            return Err(Error::invalid("--pace", "a positive number", pace.to_string()).into());
        }
        let page = if self.log.is_some() { LivePage::of_log() } else { LivePage::default() };
        match &self.log {
            Some(log) => self.draw_outlines(&page, &follow_log(log.clone(), self.pace, sender)?)?,
            None => self.follow_network(sender)?,
        }
        let stop = stop_on_signals()?;
        let Some(address) = &self.page else { return Ok(show(&receiver, stop)?) };
        serve_page(address, page, receiver, stop)?;
        while !stop.load(Ordering::Relaxed) {
            std::thread::sleep(PATIENCE);
        }
        Ok(())
    }

    /// Gives the page the outlines of the log's own bank, where it is given.
    fn draw_outlines(&self, page: &LivePage, of: &Setup) -> Result<()> {
        let (Some(path), Some(model)) = (&self.bank, &self.model) else { return Ok(()) };
        let bank = Bank::load(path, &Model::load(model)?)?;
        let sha256 = bank.sha256()?;
        if sha256 != of.bank_sha256 {
            let expected = format!("the bank that the log is of, {:.12}", of.bank_sha256);
            return Err(Error::invalid(path.display().to_string(), expected, format!("{sha256:.12}")).into());
        }
        page.knows(bank.into(), of.parameters.side);
        Ok(())
    }

    #[cfg(not(feature = "ros2"))]
    #[allow(clippy::unused_self, reason = "the same as with ROS 2")]
    fn follow_network(&self, _: std::sync::mpsc::SyncSender<tactile_live::shell::views::Shown>) -> Result<()> {
        Err(super::ros::no_ros().into())
    }

    #[cfg(feature = "ros2")]
    fn follow_network(&self, sender: std::sync::mpsc::SyncSender<tactile_live::shell::views::Shown>) -> Result<()> {
        use tactile_live::shell::watch::follow_network;

        let (bus, inbox) = super::ros::open("tactile_watch", &self.ros_args)?;
        Ok(follow_network(bus, inbox, &self.node, sender)?)
    }
}
