//! Addresses of streams and cameras: the supported ones, and the inputs that ffmpeg may open for each.

use std::borrow::Cow;
use std::path::Path;

use crate::ffmpeg::{Input, KINDS};

/// A kind of address, and its options of ffmpeg.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scheme {
    name: &'static str,
    protocols: &'static str,
    options: &'static [&'static str],
    /// The options with which ffmpeg waits for a sender.
    pub listen: Option<&'static [&'static str]>,
    /// A transfer without an error has an end: there is nothing to open again.
    pub ends: bool,
}

const SCHEMES: [Scheme; 4] = [
    Scheme {
        name: "rtsp://",
        protocols: "rtsp,tcp",
        options: &["-rtsp_transport", "tcp"],
        listen: Some(&["-rtsp_flags", "listen"]),
        ends: false,
    },
    Scheme { name: "http://", protocols: "http,tcp", options: &[], listen: Some(&["-listen", "1"]), ends: true },
    Scheme { name: "https://", protocols: "https,tls,tcp", options: &[], listen: None, ends: true },
    Scheme { name: "/dev/video", protocols: "file", options: &["-f", "v4l2"], listen: None, ends: false },
];

/// Formats without time stamps: ffmpeg makes up times for them, by a rate that is often a guess.
const UNTIMED: [&str; 17] = [
    "mpjpeg",
    "mjpeg",
    "mjpeg_2000",
    "h264",
    "hevc",
    "vvc",
    "av1",
    "obu",
    "m4v",
    "mpegvideo",
    "h263",
    "h261",
    "dirac",
    "vc1",
    "cavsvideo",
    "avs2",
    "avs3",
];

impl Scheme {
    pub(crate) fn of(address: &Path) -> Option<Self> {
        let text = address.to_str()?;
        SCHEMES
            .into_iter()
            .find(|scheme| text.get(..scheme.name.len()).is_some_and(|s| s.eq_ignore_ascii_case(scheme.name)))
    }

    /// What ffmpeg opens at an address, and all that it may open for it.
    pub(crate) fn input(&self, address: &Path) -> Input {
        let lists = address.to_string_lossy().split(['?', '#']).next().is_some_and(|path| path.ends_with(".m3u8"));
        let kinds: Cow<'static, str> = match self.name {
            "rtsp://" => "rtsp".into(),
            "/dev/video" => "video4linux2,v4l2".into(),
            _ if lists => format!("{KINDS},hls").into(),
            _ => KINDS.into(),
        };
        let options = self.options.iter().map(|&option| option.to_owned()).collect();
        Input { name: address.into(), protocols: self.protocols, kinds, options }
    }
}

/// Whether a format that ffmpeg names so has time stamps.
pub(crate) fn is_timed(format: &str) -> bool {
    !format.split(',').any(|name| UNTIMED.contains(&name))
}

/// Whether this is the address of a stream or a camera, not a path.
pub fn is_live(address: &Path) -> bool {
    Scheme::of(address).is_some()
}

/// The address of a stream as it may be shown: without the name and the password that may stand before its host. Other text stays.
pub fn without_password(address: &str) -> Cow<'_, str> {
    let (Some(_), Some((scheme, rest))) = (Scheme::of(Path::new(address)), address.split_once("://")) else {
        return address.into();
    };
    let host = rest.find(['/', '?', '#']).unwrap_or(rest.len());
    match rest[..host].rfind('@') {
        Some(at) => format!("{scheme}://{}", &rest[at + 1..]).into(),
        None => address.into(),
    }
}

/// The name of the protocol if it is an unsupported one.
pub(crate) fn other_protocol(address: &Path) -> Option<&str> {
    let (name, _) = address.to_str()?.split_once("://")?;
    let named = name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.chars().all(|c| c.is_ascii_alphanumeric() || "+-.".contains(c));
    (named && !is_live(address)).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(address: &str) -> String {
        let address = Path::new(address);
        let input = Scheme::of(address).expect("a scheme").input(address);
        input.guards().map(|word| word.to_string_lossy().into_owned()).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn each_scheme_has_its_own_protocols() {
        for (address, protocols) in [
            ("rtsp://host/live", "-protocol_whitelist rtsp,tcp "),
            ("RTSP://host/live", "-protocol_whitelist rtsp,tcp "),
            ("http://host/a.ts", "-protocol_whitelist http,tcp "),
            ("https://host/a.ts", "-protocol_whitelist https,tls,tcp "),
            ("/dev/video0", "-protocol_whitelist file "),
        ] {
            assert!(options(address).contains(protocols), "{address}");
        }
        // A list of files is read where the address names one.
        assert!(options("http://h/a.m3u8?x=1").ends_with(",hls") && !options("http://h/a.ts?b.m3u8").contains("hls"));
        for path in [
            "a.mp4",
            "file:a",
            "concat:a|b",
            "udp://h:1",
            "ftp://h/a",
            "-",
            "/dev/zero",
            "rtsp",
            "\u{e9}\u{e9}\u{e9}\u{e9}",
        ] {
            assert!(!is_live(Path::new(path)), "{path}");
        }
    }

    #[test]
    fn passwords_are_not_shown() {
        for (address, shown) in [
            ("rtsp://me:se@cret@host:554/live?user=a@b", "rtsp://host:554/live?user=a@b"),
            ("HTTPS://me@host#x", "HTTPS://host#x"),
            ("http://host/a@b", "http://host/a@b"),
            ("/dev/video0", "/dev/video0"),
            ("a folder/me:word@b", "a folder/me:word@b"),
            ("ftp://me:word@host", "ftp://me:word@host"),
        ] {
            assert_eq!(without_password(address), shown);
        }
    }

    #[test]
    fn other_protocols_have_a_name() {
        for (address, name) in [
            ("udp://127.0.0.1:5000", Some("udp")),
            ("srt://h:1?mode=listener", Some("srt")),
            ("rtsp://h/x", None),
            ("a.mp4", None),
            ("C:\\a.mp4", None),
            ("folder/a://b", None),
        ] {
            assert_eq!(other_protocol(Path::new(address)), name, "{address}");
        }
    }
}
