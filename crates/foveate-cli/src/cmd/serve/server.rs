//! Connections: one thread each, with a maximum number.

mod door;

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Duration;

use super::http::{Connection, Ended, Request, Response};
use door::{Door, Guest};

/// Time limit for an idle connection and for sending a response.
const SILENCE: Duration = Duration::from_secs(30);
/// Interval between checks of the stop condition.
const POLL: Duration = Duration::from_millis(100);

/// Computes the response to a request.
pub(super) type Answer = dyn Fn(&Request) -> Response + Send + Sync;

/// Decides from the head of a request whether a large body is accepted.
pub(super) type Trusted = dyn Fn(&Request) -> bool + Send + Sync;

/// Serves requests until `stop` returns true.
pub(super) fn serve(
    listener: &TcpListener,
    answer: &Arc<Answer>,
    trusted: &Arc<Trusted>,
    stop: &Arc<dyn Fn() -> bool + Send + Sync>,
) -> std::io::Result<()> {
    wake(listener.local_addr()?, Arc::clone(stop))?;
    let door = Arc::new(Door::default());
    for stream in listener.incoming() {
        if stop() {
            break;
        }
        let Ok(stream) = stream else {
            // Too many open files: wait until others close.
            std::thread::sleep(POLL);
            continue;
        };
        let Some(guest) = door.enter(&stream) else { continue };
        let (answer, trusted) = (Arc::clone(answer), Arc::clone(trusted));
        // If no thread can be started, the connection is closed.
        let _ = foveate::thread::started(move || {
            let _ = catch_unwind(AssertUnwindSafe(|| converse(stream, &guest, &*answer, &*trusted)));
        });
    }
    Ok(())
}

/// Connects to the listener once `stop` returns true, because a listener blocks until a connection arrives.
fn wake(mut address: SocketAddr, stop: Arc<dyn Fn() -> bool + Send + Sync>) -> std::io::Result<()> {
    if address.ip().is_unspecified() {
        address.set_ip(if address.is_ipv4() { [127, 0, 0, 1].into() } else { std::net::Ipv6Addr::LOCALHOST.into() });
    }
    let wait = move || {
        while !stop() {
            std::thread::sleep(POLL);
        }
        let _ = TcpStream::connect_timeout(&address, SILENCE);
    };
    foveate::thread::started(wait)
}

fn converse(stream: TcpStream, guest: &Guest, answer: &Answer, trusted: &Trusted) {
    let timed = stream.set_read_timeout(Some(SILENCE)).and(stream.set_write_timeout(Some(SILENCE)));
    if timed.and(stream.set_nodelay(true)).is_err() {
        return;
    }
    let mut connection = Connection::new(stream);
    loop {
        let (response, keep) = match connection.request(trusted) {
            Ok(request) => {
                guest.asks(trusted(&request));
                let answered = catch_unwind(AssertUnwindSafe(|| answer(&request)));
                let mut response =
                    answered.unwrap_or_else(|_| Response::error(500, "an error of the program; open the video again"));
                if request.method == "HEAD" {
                    // Bytes after the head would be read as the next response.
                    response.body.clear();
                }
                (response, request.keep)
            }
            Err(Ended::Refused(status, what)) => (Response::error(status, what), false),
            Err(Ended::Gone) => return,
        };
        if connection.respond(&response, keep).is_err() || !keep {
            let _ = connection.stream().shutdown(std::net::Shutdown::Write);
            return;
        }
        guest.waits();
    }
}
