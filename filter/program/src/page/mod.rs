//! A page of our own over HTTP, for browsers on this machine.
//!
//! In: an address, and who answers. Out: replies. Pages of other sites can neither read nor press anything: each request must name this
//! server as its host, and what changes something must come from a page of its own. It must not know what the page shows.

pub mod live;

use std::io::Read;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tactile_live::{Error, Result};
use tiny_http::{Header, Method, Request, Response, Server};

/// Threads that answer: a slow reader keeps one of them.
const N_THREADS: usize = 4;

/// The largest body of a request, bytes.
const MOST_BYTES: usize = 4096;

/// How often a thread that waits looks whether to stop.
pub const PATIENCE: Duration = Duration::from_millis(100);

/// Nothing of other sites runs or is loaded in the page, and no other site may show it.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; \
                      connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What is answered.
#[derive(Debug)]
pub enum Reply {
    /// A text of a content type.
    Text(&'static str, String),
    /// There is no such page.
    Nowhere,
    /// What was asked makes no sense; why.
    Refused(String),
}

/// What a browser asks.
#[derive(Debug)]
pub struct Asked {
    /// The path, without the first slash.
    pub path: String,
    /// What follows a question mark; nothing without one.
    pub query: String,
    /// The body of a request that changes something; nothing of one that only reads.
    pub body: Option<String>,
}

/// A server that is bound to its address.
pub struct PageServer {
    server: Server,
    address: SocketAddr,
}

impl PageServer {
    /// Binds to an address such as 127.0.0.1:8765.
    ///
    /// # Errors
    /// An address that is none or that is taken.
    pub fn bind(address: &str) -> Result<Self> {
        let wrong = |got: String| Error::invalid("--page", "an address such as 127.0.0.1:8765 that is free", got);
        let found = address.to_socket_addrs().map_err(|error| wrong(format!("{address}: {error}")))?.next();
        let found = found.ok_or_else(|| wrong(address.to_owned()))?;
        let listener = TcpListener::bind(found).map_err(|error| wrong(format!("{address}: {error}")))?;
        let address = listener.local_addr().map_err(|error| wrong(error.to_string()))?;
        let server = Server::from_listener(listener, None).map_err(|error| wrong(error.to_string()))?;
        Ok(Self { server, address })
    }

    /// Where a browser finds it.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }

    /// Answers until a stop is asked for.
    pub fn serve(&self, stop: &AtomicBool, answer: &(dyn Fn(Asked) -> Reply + Sync)) {
        std::thread::scope(|scope| {
            for _ in 0..N_THREADS {
                scope.spawn(|| {
                    while !stop.load(Ordering::Relaxed) {
                        if let Ok(Some(request)) = self.server.recv_timeout(PATIENCE) {
                            self.answer(request, answer);
                        }
                    }
                });
            }
        });
    }

    /// Answers one request. That its client is gone is its own matter.
    fn answer(&self, mut request: Request, answer: &(dyn Fn(Asked) -> Reply + Sync)) {
        let reply = match self.checked(&mut request) {
            Ok(asked) => answer(asked),
            Err(why) => Reply::Refused(why),
        };
        let (status, kind, text) = match reply {
            Reply::Text(kind, text) => (200, kind, text),
            Reply::Nowhere => (404, "text/plain; charset=utf-8", "no such page".into()),
            Reply::Refused(why) => (400, "text/plain; charset=utf-8", why),
        };
        let mut response = Response::from_string(text).with_status_code(status);
        let headers = [
            ("content-type", kind),
            ("content-security-policy", POLICY),
            ("x-content-type-options", "nosniff"),
            ("cache-control", "no-store"),
            ("referrer-policy", "no-referrer"),
        ];
        for (name, value) in headers {
            if let Ok(header) = Header::from_bytes(name, value) {
                response.add_header(header);
            }
        }
        let _gone = request.respond(response);
    }

    /// The request, if it is one of a page of this server.
    fn checked(&self, request: &mut Request) -> std::result::Result<Asked, String> {
        let header = |request: &Request, name: &'static str| {
            let found = request.headers().iter().find(|header| header.field.equiv(name));
            found.map(|header| header.value.as_str().to_owned())
        };
        // A name of another site may lead here (DNS rebinding); its pages then name that site.
        let host = header(request, "host").unwrap_or_default();
        if !self.is_own(&host) {
            return Err(format!("host: expected {}, got another", self.address));
        }
        let (path, query) = request.url().split_once('?').unwrap_or((request.url(), ""));
        let (path, query) = (path.trim_start_matches('/').to_owned(), query.to_owned());
        match request.method() {
            Method::Get => Ok(Asked { path, query, body: None }),
            Method::Post => {
                let origin = header(request, "origin");
                let is_from_here = origin.is_none_or(|origin| origin == format!("http://{host}"));
                // A form of another site cannot send this type without being asked first.
                let is_json = header(request, "content-type").is_some_and(|kind| kind == "application/json");
                if !is_from_here || !is_json {
                    return Err("expected JSON from this server's own page".into());
                }
                let mut body = Vec::new();
                let limit = MOST_BYTES as u64 + 1;
                request.as_reader().take(limit).read_to_end(&mut body).map_err(|error| error.to_string())?;
                if body.len() > MOST_BYTES {
                    return Err(format!("expected a body of at most {MOST_BYTES} bytes"));
                }
                let body = String::from_utf8(body).map_err(|_| "expected UTF-8".to_owned())?;
                Ok(Asked { path, query, body: Some(body) })
            }
            other => Err(format!("expected GET or POST, got {other}")),
        }
    }

    /// Whether a host's name is that of this server: its address, or this machine's own name for it.
    fn is_own(&self, host: &str) -> bool {
        let port = self.address.port();
        let is_local = self.address.ip().is_loopback() || self.address.ip().is_unspecified();
        host == self.address.to_string()
            || is_local
                && [format!("localhost:{port}"), format!("127.0.0.1:{port}"), format!("[::1]:{port}")]
                    .contains(&host.to_owned())
    }
}
