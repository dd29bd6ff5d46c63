//! Networks that others trained, from ONNX files; tract runs them, on the thread of the caller.
//!
//! Shapes are fixed when a file is read: batch, planes and sides of the input, and all that follows from them. The peak of
//! memory is known then, and is compared with the limit before anything is computed. What tract makes of a stranger's file is caught: an
//! error or a panic of it is an error of the file.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use tract_onnx::prelude::*;
use tract_onnx::tract_hir::infer::{DimFact, Factoid};
use tract_onnx::tract_hir::internal::DimLike;

use foveate_base::{Error, Result, memory, quiet};

/// A file that was read, and the shape of its input.
pub(crate) struct Graph {
    model: InferenceModel,
    path: PathBuf,
    sides: Vec<Option<usize>>,
}

/// A network with an input of fixed sides.
pub(crate) struct Network {
    plan: Arc<TypedRunnableModel>,
    path: PathBuf,
    input: Vec<usize>,
    output: Vec<usize>,
}

impl Graph {
    /// Reads a file. `path` stands for it in errors.
    pub(crate) fn read(bytes: &[u8], path: &Path) -> Result<Self> {
        let read = caught(|| {
            // Sizes of values within the graph are computed: those that a file states may be of another batch.
            let onnx = tract_onnx::onnx().with_ignore_value_info(true);
            let mut model = onnx.model_for_read(&mut &*bytes)?;
            let first = model.output_outlets()?.first().copied();
            if let Some(first) = first {
                model.select_output_outlets(&[first])?;
            }
            Ok((first.is_some(), model))
        });
        let (some, model) = read.map_err(|e| {
            Error::malformed(path, format!("not an ONNX network that can be read ({e}); export it again, in one file"))
        })?;
        let inputs = model.input_outlets().map_or(0, <[OutletId]>::len);
        if inputs != 1 || !some {
            let found = format!("it has {inputs} inputs{}", if some { "" } else { " and no output" });
            let problem =
                format!("{found}; expected one input, and the first output is taken; export the network alone");
            return Err(Error::malformed(path, problem));
        }
        let declared = caught(|| {
            let fact = model.input_fact(0)?;
            let side = |dim: &DimFact| dim.concretize().and_then(|dim| dim.to_usize().ok());
            let sides = if fact.shape.is_open() { vec![] } else { fact.shape.dims().map(side).collect() };
            Ok((fact.datum_type.concretize(), sides))
        });
        let (kind, sides) = declared.map_err(|e| Error::malformed(path, format!("its input makes no sense ({e})")))?;
        if kind.is_some_and(|kind| kind != f32::datum_type()) {
            let kind = kind.map_or("unknown".into(), |kind| format!("{kind:?}"));
            let problem =
                format!("its input holds numbers of type {kind}, expected 32-bit floats; export it with these");
            return Err(Error::malformed(path, problem));
        }
        Ok(Self { model, path: path.to_owned(), sides })
    }

    /// Sides of its input; `None` where it leaves one open.
    pub(crate) fn sides(&self) -> &[Option<usize>] {
        &self.sides
    }

    /// An error of this file.
    pub(crate) fn error(&self, problem: impl Into<String>) -> Error {
        Error::malformed(&self.path, problem)
    }

    /// The network for an input of these sides.
    ///
    /// # Errors
    /// Fails if they do not fit, an operator is unknown, sides of the output depend on the input's values, or it takes more memory
    /// than there may be.
    pub(crate) fn network(&self, sides: &[usize]) -> Result<Network> {
        let shown = fixed(sides);
        let cannot = |e: String| self.error(format!("it cannot be run with an input of {shown} ({e})"));
        let typed = caught(|| {
            let mut model = self.model.clone();
            model.set_input_fact(0, f32::fact(sides).into())?;
            let typed = model.into_typed()?;
            let peak = peak(&typed)?;
            Ok((typed, peak))
        });
        let (typed, peak) = typed.map_err(cannot)?;
        let what = format!("{}: the network, with an input of {shown},", self.path.display());
        memory::check(what, peak)?;
        let found = caught(|| {
            let fact = typed.output_fact(0)?;
            Ok((fact.datum_type, fact.shape.as_concrete().map(<[usize]>::to_vec)))
        });
        let (kind, output) = found.map_err(cannot)?;
        let Some(output) = output else {
            return Err(self.error(
                "the sides of its output depend on its input; export it without what chooses among boxes (nms=False)",
            ));
        };
        if kind != f32::datum_type() || output.iter().product::<usize>() == 0 {
            let found = fixed(&output);
            return Err(
                self.error(format!("its output is {found} of type {kind:?}, expected 32-bit floats, one at least"))
            );
        }
        let plan = caught(|| typed.into_optimized()?.into_runnable()).map_err(cannot)?;
        Ok(Network { plan, path: self.path.clone(), input: sides.to_vec(), output })
    }
}

impl Network {
    /// Sides of its output.
    pub(crate) fn output(&self) -> &[usize] {
        &self.output
    }

    /// Computes the output for `input`, which has the network's sides, row-major; `output` has as many numbers as its sides.
    ///
    /// # Errors
    /// If the network fails, `output` is undefined.
    pub(crate) fn run(&self, input: &[f32], output: &mut [f32]) -> Result<()> {
        let ran = caught(|| {
            let input = Tensor::from_shape(&self.input, input)?;
            let said = self.plan.run(tvec!(input.into()))?;
            let view = said[0].to_plain_array_view::<f32>()?;
            if view.len() != output.len() {
                return Err(TractError::msg(format!("{} numbers, expected {}", view.len(), output.len())));
            }
            output.iter_mut().zip(view.iter()).for_each(|(out, said)| *out = *said);
            Ok(())
        });
        ran.map_err(|e| Error::malformed(&self.path, format!("it failed while it ran ({e}); export it again")))
    }
}

/// Sides in words: `(N, 3, 32, 32)`.
pub(crate) fn shape(sides: &[Option<usize>]) -> String {
    let side = |side: &Option<usize>| side.map_or("N".to_owned(), |side| side.to_string());
    format!("({})", sides.iter().map(side).collect::<Vec<_>>().join(", "))
}

/// Sides of which none is open, in words.
pub(crate) fn fixed(sides: &[usize]) -> String {
    shape(&sides.iter().map(|side| Some(*side)).collect::<Vec<_>>())
}

/// Errors and panics of tract in one short line.
fn caught<T>(f: impl FnOnce() -> TractResult<T>) -> std::result::Result<T, String> {
    let said = quiet::catch(f).and_then(|result| result.map_err(|e| format!("{e:#}")));
    said.map_err(|e| {
        let line = e.split_whitespace().collect::<Vec<_>>().join(" ");
        let (mut shown, long) = (line.chars().take(300).collect::<String>(), line.chars().nth(300).is_some());
        shown.extend(long.then_some('…'));
        shown.escape_debug().to_string()
    })
}

/// Bytes that are live at the same time, at most: weights, which are packed once more, and values until they were read last.
fn peak(model: &TypedModel) -> TractResult<u64> {
    let order = model.eval_order()?;
    let bytes = |node: usize| -> u64 {
        let of = |fact: &TypedFact| {
            let sides = fact.shape.as_concrete().unwrap_or(&[]);
            let size = fact.datum_type.size_of() as u64;
            sides.iter().fold(size, |n, side| n.saturating_mul(*side as u64))
        };
        model.node(node).outputs.iter().map(|outlet| of(&outlet.fact)).fold(0, u64::saturating_add)
    };
    let constant = |node: usize| model.node(node).outputs.iter().all(|outlet| outlet.fact.konst.is_some());
    let mut last = vec![usize::MAX; model.nodes().len()];
    for (at, node) in order.iter().enumerate() {
        model.node(*node).inputs.iter().for_each(|input| last[input.node] = at);
    }
    let weights = order.iter().filter(|node| constant(**node)).fold(0u64, |n, node| n.saturating_add(bytes(*node)));
    let (mut live, mut most) = (0u64, 0u64);
    for (at, node) in order.iter().enumerate().filter(|(_, node)| !constant(**node)) {
        live = live.saturating_add(bytes(*node));
        most = most.max(live);
        let mut inputs: Vec<usize> = model.node(*node).inputs.iter().map(|input| input.node).collect();
        inputs.sort_unstable();
        inputs.dedup();
        let read = inputs.into_iter().filter(|input| last[*input] == at && !constant(*input));
        live = live.saturating_sub(read.map(bytes).fold(0, u64::saturating_add));
    }
    Ok(weights.saturating_mul(2).saturating_add(most))
}
