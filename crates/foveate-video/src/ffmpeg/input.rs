//! The input of ffmpeg, and the protocols and formats it may use.

use std::borrow::Cow;
use std::ffi::OsString;
use std::path::Path;

/// Kinds of files that hold their frames themselves. Those that name other files or addresses are left out on purpose.
pub(crate) const KINDS: &str = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpeg,mpegts,mpegtsraw,mpegvideo,vob,flv,live_flv,kux,asf,ogg,\
    h264,hevc,vvc,av1,obu,ivf,m4v,mjpeg,mjpeg_2000,mpjpeg,gif,apng,yuv4mpegpipe,nut,rm,wtv,dv,mxf,vc1,vc1test,h263,h261,dirac,swf,\
    nsv,bink,smk,ea,roq,gxf,mtv,nuv,cavsvideo,avs2,avs3,dxa,cdxl,fli,flic,lvf,mv,r3d,rpl,sdr2,thp,truehd,viv,xmv,yop";

/// What ffmpeg opens, and all that it may open for it.
#[derive(Clone, Debug)]
pub(crate) struct Input {
    /// As ffmpeg names it.
    pub name: OsString,
    pub protocols: &'static str,
    pub kinds: Cow<'static, str>,
    /// Further options.
    pub options: Vec<String>,
}

impl Input {
    /// A file of the disk.
    pub(crate) fn file(path: &Path) -> Self {
        let mut name = OsString::from("file:");
        name.push(path);
        Self {
            name,
            protocols: "file",
            kinds: KINDS.into(),
            options: kind(path).iter().map(|&o| o.to_owned()).collect(),
        }
    }

    /// The options that stand before it.
    pub(crate) fn guards(&self) -> impl Iterator<Item = OsString> + '_ {
        let allowed = ["-protocol_whitelist", self.protocols, "-format_whitelist", &self.kinds];
        allowed.into_iter().chain(self.options.iter().map(String::as_str)).map(OsString::from)
    }
}

/// Pictures one after the other begin as one picture does: ffmpeg would take the first alone.
fn kind(path: &Path) -> &'static [&'static str] {
    let jpeg = path.extension().is_some_and(|end| ["mjpeg", "mjpg"].iter().any(|name| end.eq_ignore_ascii_case(name)));
    if jpeg { &["-f", "mjpeg"] } else { &[] }
}
