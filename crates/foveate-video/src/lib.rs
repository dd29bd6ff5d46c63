#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod ahead;
pub mod annotation;
mod child;
pub mod coded;
pub mod decode;
mod decoded;
pub mod encode;
mod feed;
mod ffmpeg;
pub mod file;
pub mod folder;
pub mod frame;
mod h264;
pub mod live;
pub mod mot;
mod mp4;
pub mod mp4_writer;
mod mux;
pub mod newest;
pub mod open;
pub mod options;
pub mod otb;
mod piped;
pub mod select;
mod sps;
mod stream;
pub mod tiles;
pub mod vot;
mod y4m;
mod yuv;

pub use ahead::{ahead, ahead_until};
pub use child::Interrupt;
pub use coded::{CodedFrame, CodedVideo, Planes};
pub use decode::{decode_image, read_image};
pub use encode::{encode_jpeg, encode_png, save_png};
pub use file::VideoFile;
pub use folder::{ImageFolder, image_files};
pub use frame::{Frame, FrameSource, SourceInfo};
pub use live::{Live, LiveOptions, is_live};
pub use mp4_writer::Mp4Writer;
pub use newest::{Meter, Pace, newest};
pub use open::{open, open_with};
pub use options::{Decoder, Options, Pixels, Raw};
pub use select::{Selection, select};
pub use tiles::{TileFolder, TileFrames, write_tiles};
