//! Connections: a thread each, a bounded number of them.

use std::net::{SocketAddr, TcpListener, TcpStream};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use super::http::{Connection, Ended, Request, Response};

/// Connections at a time; more are closed at once.
const MOST: usize = 64;
/// How long a connection may say nothing, and may take to read an answer.
const SILENCE: Duration = Duration::from_secs(30);
/// How often it is asked whether to stop.
const POLL: Duration = Duration::from_millis(100);

/// Answers requests.
pub(super) type Answer = dyn Fn(&Request) -> Response + Send + Sync;

/// Says whose large bodies are taken, by the head of the request.
pub(super) type Trusted = dyn Fn(&Request) -> bool + Send + Sync;

/// Answers until `stop` says so.
pub(super) fn serve(
    listener: &TcpListener,
    answer: &Arc<Answer>,
    trusted: &Arc<Trusted>,
    stop: &Arc<dyn Fn() -> bool + Send + Sync>,
) -> std::io::Result<()> {
    wake(listener.local_addr()?, Arc::clone(stop))?;
    let count = Arc::new(AtomicUsize::new(0));
    for stream in listener.incoming() {
        if stop() {
            break;
        }
        let Ok(stream) = stream else {
            // Of too many open files: others must close first.
            std::thread::sleep(POLL);
            continue;
        };
        if count.fetch_add(1, Ordering::SeqCst) >= MOST {
            count.fetch_sub(1, Ordering::SeqCst);
            continue;
        }
        let (answer, trusted, taken) = (Arc::clone(answer), Arc::clone(trusted), Arc::clone(&count));
        let started = foveate::thread::started(move || {
            let _ = catch_unwind(AssertUnwindSafe(|| converse(stream, &*answer, &*trusted)));
            taken.fetch_sub(1, Ordering::SeqCst);
        });
        if started.is_err() {
            count.fetch_sub(1, Ordering::SeqCst);
        }
    }
    Ok(())
}

/// Comes to the door once it is to be closed, for a listener waits for somebody to come.
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

fn converse(stream: TcpStream, answer: &Answer, trusted: &Trusted) {
    let timed = stream.set_read_timeout(Some(SILENCE)).and(stream.set_write_timeout(Some(SILENCE)));
    if timed.and(stream.set_nodelay(true)).is_err() {
        return;
    }
    let mut connection = Connection::new(stream);
    loop {
        let (response, keep) = match connection.request(trusted) {
            Ok(request) => {
                let answered = catch_unwind(AssertUnwindSafe(|| answer(&request)));
                let mut response =
                    answered.unwrap_or_else(|_| Response::error(500, "an error of the program; open the video again"));
                if request.method == "HEAD" {
                    // What follows the head would be taken for the next answer.
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
    }
}
