//! Programs that serve a page, asked as a browser or a hostile client asks.

use std::io::{BufRead, BufReader, Lines, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use crate::programs::path;
use crate::samples::Sample;

/// A program that serves a page, stopped at the end.
#[derive(Debug)]
pub struct Served {
    program: Child,
    /// Host and port.
    pub address: String,
    /// Kept open: the program may say more.
    _said: Lines<BufReader<ChildStderr>>,
}

impl Served {
    /// A hole of the sample's scene, to be touched by hand.
    ///
    /// # Panics
    /// As [`Self::start`].
    pub fn of_sample(sample: &Sample) -> Self {
        let scene = ["try", "--scene", "two.toml", "--page", "127.0.0.1:0", "--seed", "3"];
        let model = ["--model", "model/model.safetensors", "--bank", "pegs.bank"];
        Self::start(sample.folder(), &[&scene[..], &model].concat())
    }

    /// Starts `tactile-filter` in a folder and waits until it says where its page is.
    ///
    /// # Panics
    /// Where it does not.
    pub fn start(folder: &Path, args: &[&str]) -> Self {
        let mut command = Command::new(path("tactile-filter"));
        command.current_dir(folder).args(args).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut program = command.spawn().expect("the program starts");
        let mut said = BufReader::new(program.stderr.take().expect("its standard error")).lines();
        // What a bank is made of comes before it.
        let line = said.find(|line| line.as_ref().is_ok_and(|line| line.starts_with("http://")));
        let line = line.expect("a line with the address").expect("text");
        let address = line.split('/').nth(2).expect("an address").to_owned();
        Self { program, address, _said: said }
    }

    /// A connection to it.
    ///
    /// # Panics
    /// Where there is none.
    pub fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    }

    /// The status and the body of what is answered.
    ///
    /// # Panics
    /// Where nothing is.
    pub fn ask(&self, line: &str, headers: &[(&str, &str)], body: &str) -> (u16, String) {
        let mut stream = self.connect();
        let mut request = format!("{line} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n", body.len());
        if !headers.iter().any(|(name, _)| *name == "Host") {
            request += &format!("Host: {}\r\n", self.address);
        }
        headers.iter().for_each(|(name, value)| request += &format!("{name}: {value}\r\n"));
        stream.write_all(format!("{request}\r\n{body}").as_bytes()).unwrap();
        let mut answered = String::new();
        stream.read_to_string(&mut answered).unwrap();
        let status = answered.split(' ').nth(1).unwrap().parse().unwrap();
        (status, answered.split_once("\r\n\r\n").unwrap().1.to_owned())
    }

    /// What the page of a hole draws.
    ///
    /// # Panics
    /// As [`Self::ask`].
    pub fn state(&self) -> Value {
        self.read("state")
    }

    /// JSON that is read.
    ///
    /// # Panics
    /// As [`Self::ask`], and where it is none.
    pub fn read(&self, path: &str) -> Value {
        serde_json::from_str(&self.ask(&format!("GET /{path}"), &[], "").1).unwrap()
    }

    /// What is answered to JSON.
    ///
    /// # Panics
    /// As [`Self::ask`].
    pub fn post(&self, path: &str, body: &Value) -> (u16, String) {
        self.ask(&format!("POST /{path}"), &[("Content-Type", "application/json")], &body.to_string())
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ended = self.program.kill();
        let _reaped = self.program.wait();
    }
}
