//! Implements `foveate serve` and `foveate pick`: a browser page to draw a box, watch the tracker and correct it.

mod app;
mod guard;
mod http;
mod live;
mod page;
mod roots;
mod save;
mod server;
mod video;

use std::net::{IpAddr, SocketAddr, TcpListener, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use foveate::{Error, Result};
use foveate_page::Page;

use super::configure::{Changes, read};
use super::track::source::SandboxArg;
use crate::terminal;
use app::{App, Pick, Server};
use guard::Guard;
use roots::Roots;

/// Minimum length of a token.
const LEAST_TOKEN: usize = 16;

/// Help text on access to the server.
const WHO: &str = "\
Only programs of this machine can open the page, unless --allow-remote is given. These include programs of the machine's other users: \
set a --token if there are any. Connections are not encrypted: to open the page from another machine, use a trusted network or a tunnel.

The page can read the given folders and videos and everything below them, but not follow links out of them. It can open only the \
streams and cameras given here.";

#[derive(clap::Args)]
#[command(after_long_help = WHO)]
pub(crate) struct Args {
    /// Folders, videos, streams (rtsp://, http://) and cameras (/dev/video0) that the page may open; default: this folder
    #[arg(value_name = "PATH", default_value = ".")]
    paths: Vec<PathBuf>,
    /// Address to listen on; port 0 selects a free port
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:8080", value_parser = parse_address)]
    address: SocketAddr,
    /// Accept requests from other machines. Requires a token, and --address with this machine's address in the network or 0.0.0.0
    #[arg(long)]
    allow_remote: bool,
    /// Secret of at least 16 letters and digits that the opened address must contain; default: $FOVEATE_TOKEN
    #[arg(long, value_name = "SECRET")]
    token: Option<String>,
    #[command(flatten)]
    page: PageArgs,
}

/// Help text on access to `pick`.
const WHO_PICK: &str = "\
Only programs of this machine can open the page, including those of its other users. If there are other users, or the browser is on \
another machine, draw the box in `foveate serve`, which has --token and --allow-remote.";

#[derive(clap::Args)]
#[command(after_long_help = WHO_PICK)]
pub(crate) struct PickArgs {
    /// Video file or folder of images
    video: PathBuf,
    /// Address to listen on, on this machine; default: a free port
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:0", value_parser = parse_address)]
    address: SocketAddr,
    /// Continue after the first box: print one line per box
    #[arg(long)]
    keep: bool,
    #[command(flatten)]
    page: PageArgs,
}

/// Initial settings of the page.
#[derive(clap::Args)]
struct PageArgs {
    /// Initially selected configuration: a name or a file
    #[arg(long, short, value_name = "FILE|NAME", default_value = "natural")]
    config: String,
    /// Gaze policy that replaces the configuration's
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(super::configure::POLICIES))]
    policy: Option<String>,
    #[command(flatten)]
    sandbox: SandboxArg,
}

/// Parses an address by number or name. If a name has several addresses, prefers the first IPv4 address, which every machine supports.
fn parse_address(text: &str) -> std::result::Result<SocketAddr, String> {
    let wrong =
        |why| format!("expected HOST:PORT such as 127.0.0.1:8080, localhost:0 or [::1]:8080, got \"{text}\": {why}");
    let all: Vec<SocketAddr> = text.to_socket_addrs().map_err(|e| wrong(e.to_string()))?.collect();
    let first = all.iter().find(|address| address.is_ipv4()).or(all.first());
    first.copied().ok_or_else(|| wrong("the name has no address".into()))
}

/// Runs `foveate serve`.
pub(crate) fn run(args: Args) -> Result<()> {
    let token = args.token.or_else(|| std::env::var("FOVEATE_TOKEN").ok().filter(|token| !token.is_empty()));
    check(&args.address, args.allow_remote, token.as_deref())?;
    start(&args.paths, args.address, token, &args.page, None)
}

/// Runs `foveate pick`.
pub(crate) fn run_pick(args: PickArgs) -> Result<()> {
    if !args.address.ip().is_loopback() {
        return Err(Error::Invalid(format!(
            "--address {}: other machines could reach it; give an address of this machine alone (127.0.0.1:0), or draw the box in \
             `foveate serve`",
            args.address
        )));
    }
    let pick = Pick { keep: args.keep, done: Arc::default() };
    start(&[args.video], args.address, None, &args.page, Some(pick))
}

/// Refuses a remotely reachable address without --allow-remote, and a token that is easy to guess.
fn check(address: &SocketAddr, remote: bool, token: Option<&str>) -> Result<()> {
    let problem = if !address.ip().is_loopback() && !remote {
        format!(
            "--address {address}: other machines could reach it; give --allow-remote and --token, or an address of this machine alone (127.0.0.1:8080)"
        )
    } else if remote && token.is_none() {
        format!("--allow-remote needs --token SECRET (or $FOVEATE_TOKEN), of at least {LEAST_TOKEN} letters and digits")
    } else if token
        .is_some_and(|t| t.len() < LEAST_TOKEN || !t.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_".contains(&b)))
    {
        format!("the token is too short or has other signs; expected at least {LEAST_TOKEN} of a-z, A-Z, 0-9, - and _")
    } else {
        return Ok(());
    };
    Err(Error::Invalid(problem))
}

fn start(
    paths: &[PathBuf],
    address: SocketAddr,
    token: Option<String>,
    page: &PageArgs,
    pick: Option<Pick>,
) -> Result<()> {
    // Errors in the configuration are reported before the user draws a box.
    let (config, folder) = read(&page.config, &Changes { policy: page.policy.clone(), set: vec![] })?;
    config.check(&folder)?;
    let roots = Roots::new(paths)?;
    if pick.is_some() && roots.list("")?.iter().all(|entry| ["folder", "stream"].contains(&entry.kind)) {
        let problem = "expected a video file or a folder of images; of a stream draw the box in `foveate serve`";
        return Err(Error::malformed(&paths[0], problem));
    }
    let threads = rayon::current_num_threads();
    let pool = crate::threads(threads)?;
    let name = address.to_string();
    let listener =
        TcpListener::bind(address).map_err(Error::io(&name, "cannot listen there; give another --address"))?;
    let bound = listener.local_addr().map_err(Error::io(&name, "cannot listen there"))?;
    let guard = Guard { port: bound.port(), remote: !address.ip().is_loopback(), token };
    let done = pick.as_ref().map_or_else(Arc::<AtomicBool>::default, |pick| Arc::clone(&pick.done));
    let waits = pick.as_ref().is_some_and(|pick| !pick.keep);
    terminal::catch_interrupts();
    announce(&bound, &guard, pick.is_some());
    let (config, policy, options) = (page.config.clone(), page.policy.clone(), page.sandbox.options());
    let page = Page::new(Server { roots, pick, config, policy, pool, options });
    let app = Arc::new(App { guard, page });
    let ending = Arc::clone(&done);
    let stop: Arc<dyn Fn() -> bool + Send + Sync> =
        Arc::new(move || terminal::stopping() || ending.load(Ordering::SeqCst));
    let answering = Arc::clone(&app);
    let answer: Arc<server::Answer> = Arc::new(move |request| answering.answer(request));
    let trusting = Arc::clone(&app);
    let trusted: Arc<server::Trusted> = Arc::new(move |request| trusting.guard.check(request).is_ok());
    let served = server::serve(&listener, &answer, &trusted, &stop);
    // Wait until the last response is sent.
    std::thread::sleep(std::time::Duration::from_millis(100));
    app.page.close(None);
    served.map_err(Error::io(Path::new(&name), "the server broke off"))?;
    // `pick` has printed no command.
    if waits && !done.load(Ordering::SeqCst) {
        std::process::exit(terminal::stop_status());
    }
    Ok(())
}

/// Prints the page's address on standard error; standard output is for the command that `pick` prints.
fn announce(bound: &SocketAddr, guard: &Guard, pick: bool) {
    let host = match bound.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => "ADDRESS-OF-THIS-MACHINE".to_owned(),
        IpAddr::V6(ip) if ip.is_unspecified() => "[ADDRESS-OF-THIS-MACHINE]".to_owned(),
        IpAddr::V6(ip) => format!("[{ip}]"),
        IpAddr::V4(ip) => ip.to_string(),
    };
    let token = guard.token.as_ref().map_or(String::new(), |token| format!("?token={token}"));
    let what = if pick { "draw a box in a browser at" } else { "open in a browser:" };
    note!("foveate: {what} http://{host}:{}/{token}  (Ctrl-C ends)", bound.port());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_numbers_or_names() {
        for text in ["127.0.0.1:18100", "localhost:18100", "[::1]:18100"] {
            let address = parse_address(text).expect(text);
            assert!(address.ip().is_loopback() && address.port() == 18100, "{address}");
        }
        for text in ["localhost", "18100", ":x", "127.0.0.1:99999", ""] {
            let said = parse_address(text).expect_err(text);
            assert!(said.contains("expected HOST:PORT") && said.contains(&format!("\"{text}\"")), "{said}");
        }
    }

    #[test]
    fn other_machines_need_a_flag_and_a_token() {
        let (here, all) = ("127.0.0.1:80".parse().expect("an address"), "0.0.0.0:80".parse().expect("an address"));
        let good = Some("0123456789abcdef");
        for (address, remote, token, right) in [
            (&here, false, None, true),
            (&here, false, good, true),
            (&here, false, Some("short"), false),
            (&all, false, None, false),
            (&all, false, good, false),
            (&all, true, None, false),
            (&all, true, Some("0123456789 abcdef"), false),
            (&all, true, good, true),
        ] {
            assert_eq!(check(address, remote, token).is_ok(), right, "{address} {remote} {token:?}");
        }
    }
}
