//! Implements `foveate trax`: a tracker for vot-toolkit and other clients of the TraX protocol.

mod message;
mod region;

use std::io::{BufReader, Write};
use std::path::Path;

use foveate::config::Blueprint;
use foveate::scene::Image;
use foveate::text::counted;
use foveate::video::read_image;
use foveate::{BBox, Error, Result, Tracker, memory};

use super::configure::Choice;
use message::Message;

/// Maximum number of objects in a session; each has its own tracker.
const MOST: usize = 256;

/// Track for a client of the TraX protocol, on standard input and output.
///
/// Images are paths of pictures (`file://...`); regions are rectangles, polygons or masks, in pixels counted from 0. Responses are
/// rectangles with the property `confidence`, 1 - P(lost). Polygons and masks are replaced with their axis-aligned bounding boxes.
///
/// By default, use version 3 of the protocol with one object. With --objects, use version 4 with several objects, each with its own
/// tracker.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    choice: Choice,
    /// Accept several objects: version 4 of the protocol
    #[arg(long)]
    objects: bool,
}

pub(crate) fn run(args: Args) -> Result<()> {
    let (blueprint, seed) = args.choice.blueprint()?;
    // Other messages go to standard error.
    crate::terminal::give_output();
    let mut output = std::io::stdout().lock();
    let mut session =
        Session { blueprint, seed, several: args.objects, planes: None, objects: vec![], bytes: 0, pending: vec![] };
    let ended = session.serve(&mut BufReader::new(std::io::stdin().lock()), &mut output);
    if let Err(error) = &ended {
        // If the client has closed the connection, there is no reader.
        let _ = send(&mut output, &message::format("quit", &[], &[("trax.reason", &error.to_string())]));
    }
    ended
}

/// The objects of a client.
struct Session {
    blueprint: Blueprint,
    seed: u64,
    /// Whether the session uses version 4 of the protocol.
    several: bool,
    /// Planes of the first picture: later pictures are converted between grey and colour to match it, as in a folder of images.
    planes: Option<usize>,
    objects: Vec<Tracker>,
    /// The estimated memory of the objects, bytes.
    bytes: u64,
    /// Version 4 objects that wait for their first picture.
    pending: Vec<BBox>,
}

impl Session {
    fn serve(&mut self, input: &mut impl std::io::BufRead, output: &mut impl Write) -> Result<()> {
        let version = if self.several { "4" } else { "3" };
        let mut hello = vec![
            ("trax.version", version),
            ("trax.name", "foveate"),
            ("trax.description", concat!("foveate ", env!("CARGO_PKG_VERSION"))),
            ("trax.image", "path;"),
            ("trax.region", "rectangle;polygon;mask;"),
            ("trax.channels", "color;"),
        ];
        if self.several {
            hello.push(("trax.multiobject", "1"));
        }
        send(output, &message::format("hello", &[], &hello))?;
        while let Some(message) = message::next(input)? {
            let Message { kind, arguments, .. } = &message;
            let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
            let answer = match (kind.as_str(), self.several, &arguments[..]) {
                ("quit", _, _) => return Ok(()),
                ("initialize", false, [image, region]) => {
                    self.clear();
                    self.pending.push(region::parse(region)?);
                    self.frame(image)?
                }
                ("initialize", true, []) => {
                    self.clear();
                    continue;
                }
                ("initialize", true, [region]) => {
                    if self.objects.len() + self.pending.len() >= MOST {
                        return Err(Error::Invalid(format!(
                            "more than {MOST} objects; start another process for more"
                        )));
                    }
                    self.pending.push(region::parse(region)?);
                    continue;
                }
                ("frame", _, [image]) if !(self.objects.is_empty() && self.pending.is_empty()) => self.frame(image)?,
                ("frame", _, [_]) => {
                    return Err(Error::Invalid("a frame before any object; send initialize first".into()));
                }
                _ => return Err(unexpected(&message, self.several)),
            };
            send(output, &answer)?;
        }
        Ok(())
    }

    fn clear(&mut self) {
        self.objects.clear();
        self.bytes = 0;
        self.pending.clear();
        self.planes = None;
    }

    /// Checks whether memory suffices for the objects that wait for this picture.
    fn check_memory(&mut self, image: &Image) -> Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        let size = image.size();
        let more = self.pending.iter().map(|bbox| self.blueprint.memory_of_tracker(bbox, size));
        self.bytes = more.fold(self.bytes, u64::saturating_add);
        let objects = self.objects.len() + self.pending.len();
        let picture = memory::of_picture(size.width, size.height);
        memory::check(format_args!("{}", counted(objects, "object")), self.bytes.saturating_add(picture))
    }

    /// Passes a picture to every object, starts those that wait for it, and returns the states of all in order.
    fn frame(&mut self, uri: &str) -> Result<String> {
        let image = self.picture(uri)?;
        self.check_memory(&image)?;
        let mut answer = String::new();
        for tracker in &mut self.objects {
            let seen = tracker.update(&image)?;
            answer += &state(&seen.bbox, 1.0 - seen.p_lost);
        }
        for bbox in self.pending.drain(..) {
            let mut tracker = self.blueprint.tracker_of(self.seed, self.objects.len() as u64)?;
            tracker.init(&image, bbox)?;
            self.objects.push(tracker);
            answer += &state(&bbox, 1.0);
        }
        Ok(answer)
    }

    fn picture(&mut self, uri: &str) -> Result<Image> {
        let image = read_image(Path::new(path(uri)?))?;
        let planes = *self.planes.get_or_insert(image.planes());
        Ok(image.with_planes(planes))
    }
}

/// Returns the path in an image's address. As in libtrax, the address is not escaped.
fn path(uri: &str) -> Result<&str> {
    if let Some(rest) = uri.strip_prefix("file:") {
        return Ok(rest.strip_prefix("//").unwrap_or(rest));
    }
    let scheme = uri.split_once(':').map(|(scheme, _)| scheme);
    match scheme.filter(|s| s.len() > 1 && s.bytes().all(|b| b.is_ascii_lowercase() || b == b'+')) {
        Some(scheme) => Err(Error::Invalid(format!(
            "an image as {scheme}:...; expected a path, file:///folder/image.jpg, as in the hello message (trax.image=path)"
        ))),
        None => Ok(uri),
    }
}

fn unexpected(message: &Message, several: bool) -> Error {
    let expected = match several {
        false => "initialize IMAGE REGION, frame IMAGE or quit",
        true => "initialize REGION, initialize, frame IMAGE or quit",
    };
    let (kind, n) = (message.kind.chars().take(40).collect::<String>(), message.arguments.len());
    Error::Invalid(format!("expected {expected}, found \"{kind}\" with {n} arguments"))
}

fn state(bbox: &BBox, confidence: f64) -> String {
    message::format("state", &[&region::format(bbox)], &[("confidence", &format!("{confidence:.4}"))])
}

fn send(output: &mut impl Write, text: &str) -> Result<()> {
    let sent = output.write_all(text.as_bytes()).and_then(|()| output.flush());
    sent.map_err(|e| Error::Invalid(format!("cannot write to standard output: {e}")))
}
