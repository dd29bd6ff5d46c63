//! The maximum number of connections, and the connection that makes room for a new one.

use std::cmp::Reverse;
use std::net::{IpAddr, Shutdown, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Maximum number of connections.
const MOST: usize = 64;

/// The open connections, the longest idle first.
#[derive(Default)]
pub(super) struct Door {
    open: Mutex<Open>,
}

#[derive(Default)]
struct Open {
    next: u64,
    peers: Vec<Peer>,
}

struct Peer {
    id: u64,
    stream: TcpStream,
    address: IpAddr,
    /// Whether a request of this connection passed the checks.
    trusted: bool,
    /// Whether a request is being answered.
    busy: bool,
}

/// An open connection; it leaves when this is dropped.
pub(super) struct Guest {
    door: Arc<Door>,
    id: u64,
}

impl Door {
    /// Admits a connection. If there are too many, closes an idle one: one that never passed the checks before one that did, of the address
    /// with the most connections, and of these the longest idle. Returns `None` if none is idle.
    pub(super) fn enter(self: &Arc<Self>, stream: &TcpStream) -> Option<Guest> {
        let (address, stream) = (stream.peer_addr().ok()?.ip(), stream.try_clone().ok()?);
        let mut open = self.lock();
        if open.peers.len() >= MOST {
            let from = |address: IpAddr| open.peers.iter().filter(|peer| peer.address == address).count();
            let idle = open.peers.iter().enumerate().filter(|(_, peer)| !peer.busy);
            let (at, _) = idle.min_by_key(|(_, peer)| (peer.trusted, Reverse(from(peer.address))))?;
            // The thread of this connection then ends.
            let _ = open.peers.remove(at).stream.shutdown(Shutdown::Both);
        }
        let id = open.next;
        open.next += 1;
        open.peers.push(Peer { id, stream, address, trusted: false, busy: false });
        Some(Guest { door: Arc::clone(self), id })
    }

    fn lock(&self) -> MutexGuard<'_, Open> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Guest {
    /// Notes that a request is being answered, and whether it passed the checks.
    pub(super) fn asks(&self, trusted: bool) {
        self.change(|peer| (peer.busy, peer.trusted) = (true, peer.trusted || trusted));
    }

    /// Notes that the connection is idle from now on.
    pub(super) fn waits(&self) {
        self.change(|peer| peer.busy = false);
    }

    /// Changes the connection, and makes it the one that was idle for the shortest time.
    fn change(&self, change: impl FnOnce(&mut Peer)) {
        let mut open = self.door.lock();
        if let Some(at) = open.peers.iter().position(|peer| peer.id == self.id) {
            let mut peer = open.peers.remove(at);
            change(&mut peer);
            open.peers.push(peer);
        }
    }
}

impl Drop for Guest {
    fn drop(&mut self) {
        self.door.lock().peers.retain(|peer| peer.id != self.id);
    }
}
