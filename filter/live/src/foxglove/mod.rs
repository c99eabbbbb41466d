//! Live views in Foxglove or the open Lichtblick, over a websocket. Feature `foxglove`.
//!
//! The main type is [`Views`]: topics whose messages, in CDR as ROS 2 has them, go to every viewer that asks for them.
//! They are the bytes of the network and of the log; a viewer reads them by the definition of their type. It must not
//! know what they mean. `filter/live/foxglove-layout.json` is a layout for the node's topics.
//!
//! ```no_run
//! # fn main() -> tactile_live::foxglove::Result<()> {
//! use tactile_data::recording::ros::definitions::COMPRESSED_IMAGE;
//! use tactile_live::foxglove::Views;
//!
//! let views = Views::open("127.0.0.1:8765")?;
//! let image = views.channel("/gelsight/image", "sensor_msgs/msg/CompressedImage", COMPRESSED_IMAGE)?;
//! views.send(image, 1_700_000_000_000_000_000, &[0, 1, 0, 0]);
//! # Ok(())
//! # }
//! ```

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{ChannelId, Context, PartialMetadata, RawChannel, Schema, WebSocketServerHandle};

/// Messages that wait for one viewer at most; a slow one loses the oldest.
const MAX_WAITING: usize = 64;

/// Largest message that is kept for viewers that come later, bytes.
const MAX_KEPT: usize = 4 << 20;

/// The result of this module's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// An error of the views.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An address that is none.
    #[error("address of the views: expected HOST:PORT, got {got:?}")]
    Address {
        /// What came.
        got: String,
    },
    /// The server refused something.
    #[error("{what}: {source}")]
    Server {
        /// The address or the topic.
        what: String,
        /// Its reason.
        source: foxglove::FoxgloveError,
    },
}

/// One topic of the views.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Channel(usize);

/// A server for viewers. Sending never waits for one. Dropping it ends their connections.
pub struct Views {
    context: Arc<Context>,
    kept: Arc<Kept>,
    /// `None` only while it is dropped.
    server: Option<WebSocketServerHandle>,
}

/// The last message of each channel, for viewers that come later.
#[derive(Default)]
struct Kept(Mutex<Vec<Shown>>);

struct Shown {
    channel: Arc<RawChannel>,
    /// When it was, ns since 1970, and the message.
    last: Option<(u64, Vec<u8>)>,
}

impl Kept {
    fn lock(&self) -> MutexGuard<'_, Vec<Shown>> {
        // The list is whole after each line below, so a panic elsewhere leaves it usable.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn of(&self, id: ChannelId) -> Option<(Arc<RawChannel>, u64, Vec<u8>)> {
        let shown = self.lock();
        let found = shown.iter().find(|shown| shown.channel.id() == id)?;
        let (time_ns, message) = found.last.clone()?;
        Some((Arc::clone(&found.channel), time_ns, message))
    }
}

impl ServerListener for Kept {
    fn on_subscribe(&self, client: Client, channel: ChannelView) {
        if let (Some((channel, time_ns, message)), Some(viewer)) = (self.of(channel.id()), client.sink_id()) {
            channel.log_with_meta_to_sink(&message, PartialMetadata::with_log_time(time_ns), Some(viewer));
        }
    }
}

impl Views {
    /// Serves at an address, `127.0.0.1:8765` say; port 0 takes a free one.
    ///
    /// # Errors
    /// An address that is none, or that is taken.
    pub fn open(address: &str) -> Result<Self> {
        let wrong = || Error::Address { got: address.to_owned() };
        let (host, port) = address.rsplit_once(':').ok_or_else(wrong)?;
        let port = port.parse().map_err(|_| wrong())?;
        let (context, kept) = (Context::new(), Arc::new(Kept::default()));
        let server = context.websocket_server().name("tactile-filter").bind(host, port);
        let server = server.message_backlog_size(MAX_WAITING).listener(Arc::clone(&kept) as Arc<dyn ServerListener>);
        let server = server.start_blocking().map_err(|source| Error::Server { what: address.to_owned(), source })?;
        Ok(Self { context, kept, server: Some(server) })
    }

    /// The port that it serves at.
    pub fn port(&self) -> u16 {
        self.server.as_ref().map_or(0, WebSocketServerHandle::port)
    }

    /// How many viewers are connected.
    pub fn n_viewers(&self) -> usize {
        self.server.as_ref().map_or(0, WebSocketServerHandle::client_count)
    }

    /// A topic of messages in CDR: its type as `package/msg/Name`, and its definition with those of all types in it, as
    /// MCAP's `ros2msg` has them.
    ///
    /// # Errors
    /// The server refuses the topic.
    pub fn channel(&self, topic: &str, message_type: &str, definition: &str) -> Result<Channel> {
        let schema = Schema::new(message_type, "ros2msg", definition.as_bytes().to_vec());
        let builder = self.context.channel_builder(topic).message_encoding("cdr").schema(schema);
        let channel = builder.build_raw().map_err(|source| Error::Server { what: topic.to_owned(), source })?;
        let mut shown = self.kept.lock();
        shown.push(Shown { channel, last: None });
        Ok(Channel(shown.len() - 1))
    }

    /// Shows a message, header and body, at `time_ns` since 1970. A viewer that comes later gets the last one of each
    /// topic, up to 4 MiB.
    pub fn send(&self, channel: Channel, time_ns: u64, cdr: &[u8]) {
        let mut shown = self.kept.lock();
        let Some(shown) = shown.get_mut(channel.0) else { return };
        shown.channel.log_with_meta(cdr, PartialMetadata::with_log_time(time_ns));
        shown.last = (cdr.len() <= MAX_KEPT).then(|| (time_ns, cdr.to_vec()));
    }
}

impl Drop for Views {
    fn drop(&mut self) {
        if let Some(server) = self.server.take() {
            // Its tasks end by themselves; nobody waits for a viewer.
            drop(server.stop());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_that_is_none_is_named() {
        for address in ["", "8765", "localhost:", "localhost:x", "localhost:99999"] {
            let error = Views::open(address).err().map(|error| error.to_string());
            assert_eq!(error, Some(format!("address of the views: expected HOST:PORT, got {address:?}")));
        }
    }
}
