//! One line per frame, written as soon as the frame is tracked.
//!
//! JSON has, in this order: `frame` (from 1), `time` (seconds from the first frame), `bbox` (pixels, from 0), `covariance` (xx, xy and yy of
//! the centre, px²; `null` for a given box), `p_lost` (0 to 1), `status` (`given` for a given box), `dropped` (number of source frames so far that were not tracked), `damaged` (number of source frames so far
//! in which the decoder reported damage; it reads a few frames ahead) and `latency_ms` (from reading the complete frame to this line;
//! `null` if frames are not timed). With many targets: `frame`, `time`, `targets`, `dropped`, `damaged`, `latency_ms`; each target has
//! `id`, `bbox`, `covariance`, `phase` and `deficit`. MOT lines are those of tracks.txt; a single target has the id 1 and the confidence 1 − P(lost).
//! Frames with an unusable box (occluded or lost) are left out.

use std::io::{ErrorKind, Write};
use std::net::UdpSocket;

use serde::Serialize;

use crate::Observer;
use crate::tracks::mot_line;
use foveate_base::{Error, Result};
use foveate_core::Seen;
use foveate_core::geometry::BBox;
use foveate_video::{Frame, Meter, Remarks};

/// The format of the lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Format {
    /// One JSON object per frame.
    #[default]
    Json,
    /// MOTChallenge's text, one line per target.
    Mot,
}

/// Writes each frame's result immediately.
pub struct Stream {
    out: Box<dyn Write + Send>,
    format: Format,
    meter: Option<Meter>,
    remarks: Remarks,
    line: String,
    many: bool,
    /// Most bytes of a line.
    most: usize,
    /// Lines that are longer.
    unsent: u64,
}

foveate_base::opaque_debug!(Stream);

#[derive(Serialize)]
struct One<'a> {
    frame: usize,
    time: f64,
    bbox: &'a BBox,
    covariance: Option<[f64; 3]>,
    p_lost: f64,
    status: &'a str,
    dropped: u64,
    damaged: u64,
    latency_ms: Option<f64>,
}

#[derive(Serialize)]
struct Many<'a> {
    frame: usize,
    time: f64,
    targets: Vec<Target<'a>>,
    dropped: u64,
    damaged: u64,
    latency_ms: Option<f64>,
}

#[derive(Serialize)]
struct Target<'a> {
    id: u64,
    bbox: BBox,
    covariance: Option<[f64; 3]>,
    phase: &'a str,
    deficit: f64,
}

impl Stream {
    /// Creates an observer that writes lines to a writer and flushes it after each frame. `meter` belongs to a source that drops or times
    /// frames, `remarks` to the source.
    pub fn new(out: impl Write + Send + 'static, format: Format, meter: Option<Meter>, remarks: Remarks) -> Self {
        Self {
            out: Box::new(out),
            format,
            meter,
            remarks,
            line: String::new(),
            many: false,
            most: usize::MAX,
            unsent: 0,
        }
    }

    /// Creates an observer that sends lines to an address (`HOST:PORT`), one datagram per frame, whether or not anyone receives them.
    ///
    /// # Errors
    /// The address is invalid.
    pub fn udp(address: &str, format: Format, meter: Option<Meter>, remarks: Remarks) -> Result<Self> {
        let wrong = |e: std::io::Error| {
            Error::Invalid(format!("--stream udp:{address}: expected a host and a port, as 127.0.0.1:9000 ({e})"))
        };
        // Bind to the same address family.
        let socket = UdpSocket::bind("0.0.0.0:0").and_then(|s| s.connect(address).map(|()| s));
        let socket = socket.or_else(|_| UdpSocket::bind("[::]:0").and_then(|s| s.connect(address).map(|()| s)));
        Ok(Self { most: DATAGRAM, ..Self::new(Datagrams(socket.map_err(wrong)?), format, meter, remarks) })
    }

    /// Returns the observer for a run with many targets.
    #[must_use]
    pub fn of_many(self) -> Self {
        Self { many: true, ..self }
    }

    fn measured(&self) -> (u64, Option<f64>) {
        let meter = self.meter.as_ref();
        let latency = meter.and_then(Meter::latency).map(|time| (time.as_secs_f64() * 1e6).round() / 1e3);
        (meter.map_or(0, Meter::dropped), latency)
    }

    /// Writes the line of one target.
    fn one(&mut self, frame: &Frame, seen: &Seen<'_>) -> Result<()> {
        let (bbox, p_lost) = (&seen.bbox, seen.p_lost);
        match self.format {
            Format::Json => {
                let (dropped, latency_ms) = self.measured();
                let (frame, time, damaged) = (frame.index + 1, frame.time, self.remarks.damaged());
                let status = if seen.is_given() { "given" } else { seen.status.name() };
                let covariance = seen.centre_covariance();
                self.json(&One { frame, time, bbox, covariance, p_lost, status, dropped, damaged, latency_ms })
            }
            Format::Mot => {
                if seen.is_usable() {
                    mot_line(&mut self.line, frame, 1, bbox, 1.0 - p_lost);
                }
                self.send()
            }
        }
    }

    fn json(&mut self, line: &impl Serialize) -> Result<()> {
        let text = serde_json::to_string(line).map_err(|e| Error::Invalid(e.to_string()))?;
        self.line.push_str(&text);
        self.line.push('\n');
        self.send()
    }

    fn send(&mut self) -> Result<()> {
        if self.line.len() > self.most {
            self.unsent += 1;
            self.line.clear();
            return Ok(());
        }
        let sent = self.out.write_all(self.line.as_bytes()).and_then(|()| self.out.flush());
        self.line.clear();
        sent.map_err(|e| match e.kind() {
            ErrorKind::BrokenPipe => Error::Invalid("--stream: the reader of standard output has gone".into()),
            _ => Error::Invalid(format!("--stream: cannot write: {e}")),
        })
    }
}

impl Observer for Stream {
    fn observe(&mut self, frame: &Frame, targets: &[Seen<'_>]) -> Result<()> {
        if let (false, [seen, ..]) = (self.many, targets) {
            return self.one(frame, seen);
        }
        if self.format == Format::Mot {
            for target in targets.iter().filter(|target| target.is_usable()) {
                mot_line(&mut self.line, frame, target.id, &target.bbox, (1.0 - target.consistency.deficit).max(0.0));
            }
            return self.send();
        }
        let of = |t: &Seen<'_>| {
            let (id, bbox, deficit) = (t.id, t.bbox, t.consistency.deficit);
            Target { id, bbox, covariance: t.centre_covariance(), phase: t.phase.name(), deficit }
        };
        let (dropped, latency_ms) = self.measured();
        let (targets, damaged) = (targets.iter().map(of).collect(), self.remarks.damaged());
        self.json(&Many { frame: frame.index + 1, time: frame.time, targets, dropped, damaged, latency_ms })
    }

    fn finish(&mut self) -> Result<()> {
        match self.unsent {
            0 => Ok(()),
            n => Err(Error::Invalid(format!(
                "--stream: {} longer than a datagram ({DATAGRAM} bytes) and not sent; track fewer targets, or give --stream json",
                if n == 1 { "1 line was".into() } else { format!("{n} lines were") }
            ))),
        }
    }
}

/// Most bytes of a datagram (IPv4).
const DATAGRAM: usize = 65_507;

/// Sends one datagram per write; datagrams without a receiver are lost.
struct Datagrams(UdpSocket);

impl Write for Datagrams {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let _ = self.0.send(bytes);
        Ok(bytes.len())
    }
    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::Status;
    use foveate_core::multi::Phase;
    use foveate_core::scene::Image;
    use std::sync::{Arc, Mutex};

    #[derive(Clone, Default)]
    struct Shared(Arc<Mutex<Vec<u8>>>);

    impl Write for Shared {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0.lock().expect("one thread").write(bytes)
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    fn frame() -> Frame {
        Frame { index: 6, time: 0.2, image: Image::grey(40, 30, 0) }
    }

    #[test]
    fn a_frame_is_a_line() {
        let bbox = BBox { x: 1.0, y: 2.5, w: 3.0, h: 4.0 };
        for (format, wanted) in [
            (
                Format::Json,
                "{\"frame\":7,\"time\":0.2,\"bbox\":{\"x\":1.0,\"y\":2.5,\"w\":3.0,\"h\":4.0},\"covariance\":null,\"p_lost\":0.0,\"status\":\"given\",\"dropped\":0,\"damaged\":0,\"latency_ms\":null}\n",
            ),
            (Format::Mot, "7,1,2.000,3.500,3.000,4.000,1.000,-1,-1,-1\n"),
        ] {
            let out = Shared::default();
            let mut stream = Stream::new(out.clone(), format, None, Remarks::default());
            stream.observe(&frame(), &[Seen::given([40, 30, 1], &bbox)]).expect("written");
            assert_eq!(String::from_utf8_lossy(&out.0.lock().expect("one thread")), wanted);
        }
        for (status, lines) in
            [(Status::Tracking, 1), (Status::Reacquired, 1), (Status::Occluded, 0), (Status::Lost, 0)]
        {
            let out = Shared::default();
            let mut stream = Stream::new(out.clone(), Format::Mot, None, Remarks::default());
            let mut seen = Seen::given([40, 30, 1], &bbox).in_phase(Phase::Tracked);
            seen.status = status;
            stream.observe(&frame(), &[seen]).expect("written");
            let text = String::from_utf8_lossy(&out.0.lock().expect("one thread")).into_owned();
            assert_eq!(text.lines().count(), lines, "{status:?}: a guess is no line");
        }
        let out = Shared::default();
        let mut stream = Stream::new(out.clone(), Format::Json, Some(Meter::default()), Remarks::default()).of_many();
        let mut target = Seen::given([40, 30, 1], &bbox);
        target.id = 3;
        stream.observe(&frame(), &[target]).expect("written");
        let text = String::from_utf8_lossy(&out.0.lock().expect("one thread")).into_owned();
        assert!(text.contains("\"targets\":[{\"id\":3,\"bbox\":{\"x\":1.0") && text.ends_with("}\n"), "{text}");
        let mut seen = Seen::given([40, 30, 1], &bbox).in_phase(Phase::Tracked);
        (seen.covariance[0], seen.covariance[1][1]) = ([4.0, 0.5, 1.0, 0.0, 0.0, 0.0, 0.0], 9.0);
        assert_eq!(seen.centre_covariance(), Some([4.0, 0.5, 9.0]), "xx, xy, yy");
    }

    /// Output to a file that reaches its limit is an error, not a line that is too long.
    #[test]
    fn a_full_file_is_an_error() {
        struct Full;
        impl Write for Full {
            fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
                Err(ErrorKind::FileTooLarge.into())
            }
            fn flush(&mut self) -> std::io::Result<()> {
                Ok(())
            }
        }
        let mut stream = Stream::new(Full, Format::Json, None, Remarks::default());
        let error = stream.observe(&frame(), &[Seen::given([40, 30, 1], &BBox::new(0.0, 0.0, 2.0, 2.0))]);
        assert!(error.expect_err("it is full").to_string().contains("cannot write"));
    }

    #[test]
    fn datagrams_arrive() {
        let receiver = UdpSocket::bind("127.0.0.1:0").expect("a port");
        let address = receiver.local_addr().expect("an address").to_string();
        let mut stream = Stream::udp(&address, Format::Json, None, Remarks::default()).expect("an address");
        let bbox = BBox { x: 0.0, y: 0.0, w: 2.0, h: 2.0 };
        stream.observe(&frame(), &[Seen::given([40, 30, 1], &bbox)]).expect("sent");
        let mut bytes = [0; 500];
        let n = receiver.recv(&mut bytes).expect("a datagram");
        assert!(bytes[..n].starts_with(b"{\"frame\":7,") && bytes[n - 1] == b'\n');
        stream.finish().expect("all were sent");
        // A crowd in one line is longer than a datagram: the run goes on, and says so at its end.
        let mut stream = stream.of_many();
        let crowd = vec![Seen::given([40, 30, 1], &bbox); 1000];
        stream.observe(&frame(), &crowd).expect("the run goes on");
        stream.observe(&frame(), &crowd[..2]).expect("sent");
        let n = receiver.recv(&mut bytes).expect("the next datagram");
        assert!(n < 500 && bytes[n - 1] == b'\n');
        let error = stream.finish().expect_err("a line was not sent").to_string();
        assert!(error.contains("1 line was longer than a datagram"), "{error}");
        assert!(
            Stream::udp("nowhere", Format::Json, None, Remarks::default())
                .expect_err("no port")
                .to_string()
                .contains("127.0.0.1:9000")
        );
    }
}
