//! An app's end of rtpsd's Unix socket, for what no honest app says.

use std::io;
use std::os::fd::{AsRawFd, OwnedFd};
use std::time::Duration;

use anyhow::{Context, Result};
use nix::sys::socket::sockopt::ReceiveTimeout;
use nix::sys::socket::{
    AddressFamily, MsgFlags, SockFlag, SockType, UnixAddr, connect, recv, send, setsockopt, socket,
};
use nix::sys::time::TimeVal;
use rtps_tests::netns::{Identity, Netns};
use rtps_user::layer::protocol::{
    FromLayer, Hello, LAYER_PROTOCOL_VERSION, MAX_PROTOCOL_MESSAGE, Resume, ToLayer,
};
use rtpsd::RunFolder;

/// See the module.
pub(crate) struct ControlSocket(OwnedFd);

impl ControlSocket {
    /// Connects as nobody to the layer of a host.
    pub(crate) fn connect(netns: &Netns) -> Result<Self> {
        Self::connect_as(Identity::NOBODY, netns)
    }

    /// Connects as somebody.
    pub(crate) fn connect_as(identity: Identity, netns: &Netns) -> Result<Self> {
        let path = RunFolder::of_namespace(netns.inode()?).layer_socket();
        let connected = netns.enter_as(identity, || -> nix::Result<OwnedFd> {
            let socket = socket(
                AddressFamily::Unix,
                SockType::SeqPacket,
                SockFlag::SOCK_CLOEXEC,
                None,
            )?;
            setsockopt(&socket, ReceiveTimeout, &TimeVal::new(10, 0))?;
            connect(socket.as_raw_fd(), &UnixAddr::new(&path)?)?;
            Ok(socket)
        });
        connected
            .map(Self)
            .with_context(|| format!("connecting to {}", path.display()))
    }

    /// Sends any bytes; false when nobody reads them any more.
    pub(crate) fn send_raw(&self, bytes: &[u8]) -> bool {
        send(self.0.as_raw_fd(), bytes, MsgFlags::MSG_NOSIGNAL).is_ok()
    }

    /// Says hello, and gives what rtpsd answers.
    pub(crate) fn hello(&self, resume: Option<Resume>) -> Result<FromLayer> {
        let hello = ToLayer::Hello(Hello {
            version: LAYER_PROTOCOL_VERSION,
            domain: 0,
            name: "intruder".to_owned(),
            doorbell_port: 0,
            // The smallest there is.
            ring_bytes: 1,
            resume,
        });
        send(
            self.0.as_raw_fd(),
            &postcard::to_stdvec(&hello)?,
            MsgFlags::MSG_NOSIGNAL,
        )?;
        let mut buffer = vec![0; MAX_PROTOCOL_MESSAGE];
        let length = recv(self.0.as_raw_fd(), &mut buffer, MsgFlags::empty())
            .map_err(io::Error::from)
            .context("waiting for the answer to a hello")?;
        Ok(postcard::from_bytes(&buffer[..length])?)
    }

    /// The slot that a hello gets.
    pub(crate) fn slot(&self) -> Result<u8> {
        match self.hello(None)? {
            FromLayer::Welcome(welcome) => Ok(welcome.slot),
            other => anyhow::bail!("no welcome but {other:?}"),
        }
    }
}

/// A pause between two connections that are given up at once.
pub(crate) const BREATH: Duration = Duration::from_millis(1);
