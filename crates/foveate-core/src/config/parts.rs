//! Constructors of components, by the names that configurations use.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::sync::Arc;

use serde::de::DeserializeOwned;

use super::kinds::{DETECTORS, ENCODERS, POLICIES, PROPOSALS, REWARDS};
use super::own::OwnPart;
use crate::control::{Autoregressive, Proposal, Reward};
use crate::gaze::Policy;
use crate::identity::calibrate::Sharpness;
use crate::identity::retina::{Foveal, FovealConfig, Retina};
use crate::identity::{Appearance, Encoder, distance};
use crate::scene::Detector;
use foveate_base::files::Files;
use foveate_base::{Error, Result};

/// Components that a program adds to those of the library, by name.
///
/// Each method registers a constructor. The constructor receives the keys beside `kind` of the section that names it, as a type of yours
/// that serde can read: use `#[serde(deny_unknown_fields)]`, so that a misspelled key is an error. It is called once for each tracker or
/// target.
///
/// ```
/// use foveate_core::config::Config;
/// use foveate_core::extend::{Parts, Policy, Rng};
/// use foveate_core::gaze::{Context, Plan};
/// use foveate_core::geometry::Gaze;
/// use serde::Deserialize;
///
/// #[derive(Deserialize)]
/// #[serde(deny_unknown_fields)]
/// struct Left {
///     by: f64,
/// }
///
/// impl Policy for Left {
///     fn plan(&mut self, _: &Context, plan: &mut Plan, _: &mut Rng) {
///         plan.only(Gaze { u: -self.by, v: 0.0, arm: None });
///     }
///     fn learn(&mut self, _: &Plan, _: &[f64]) {}
/// }
///
/// let parts = Parts::new().with_policy("left", |settings: Left| Ok(settings));
/// let config = Config::builtin("natural").expect("it ships")?.with_parts(&parts);
/// let config = config.set("policy={ kind = \"left\", by = 0.25 }")?;
/// let tracker = foveate_core::Tracker::new(config)?;
/// # Ok::<(), foveate_core::Error>(())
/// ```
#[derive(Clone, Default)]
#[must_use]
pub struct Parts {
    policies: Named<MakePolicy>,
    encoders: Named<MakeEncoder>,
    observation_models: Named<MakeAppearance>,
    proposals: Named<MakeProposal>,
    detectors: Named<MakeDetector>,
    rewards: Named<MakeReward>,
}

type MakePolicy = dyn Fn(&OwnPart) -> Result<Box<dyn Policy>> + Send + Sync;
type MakeEncoder = dyn Fn(&OwnPart, &EncoderSite<'_>) -> Result<(Foveal, Arc<dyn Encoder>)> + Send + Sync;
type MakeAppearance = dyn Fn(&OwnPart, ObservationSite) -> Result<Box<dyn Appearance>> + Send + Sync;
type MakeProposal = dyn Fn(&OwnPart, ProposalSite) -> Result<Box<dyn Proposal>> + Send + Sync;
type MakeDetector = dyn Fn(&OwnPart) -> Result<Box<dyn Detector>> + Send + Sync;
type MakeReward = dyn Fn(&OwnPart) -> Result<Box<dyn Reward>> + Send + Sync;

/// The surroundings of an encoder in a configuration.
#[derive(Clone)]
#[non_exhaustive]
pub struct EncoderSite<'a> {
    /// The retina of the configuration; `None` if it has no `[retina]`.
    pub given: Option<FovealConfig>,
    files: &'a dyn Files,
    folder: &'a Path,
}

impl<'a> EncoderSite<'a> {
    pub(super) fn new(given: Option<FovealConfig>, files: &'a dyn Files, folder: &'a Path) -> Self {
        Self { given, files, folder }
    }
    /// Returns the retina of the configuration, for an encoder that reads the glimpses of any retina.
    ///
    /// # Errors
    /// [`Error::Config`] if the configuration has no `[retina]`.
    pub fn retina(&self) -> Result<Foveal> {
        let given = self.given.clone().ok_or_else(|| {
            Error::Config(
                "retina: this encoder brings none; add one, for example [retina] kind = \"foveal\", side = 28, rings = [[8, 1], \
                 [16, 2], [24, 4]]"
                    .into(),
            )
        })?;
        Foveal::new(given)
    }
    /// The bytes of a file, whose path is relative to the configuration.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn read(&self, path: impl AsRef<Path>) -> Result<Vec<u8>> {
        self.files.read(&self.folder.join(path))
    }
}

/// The surroundings of an observation model in a configuration: it may use them, or none of them.
#[derive(Clone)]
#[non_exhaustive]
pub struct ObservationSite {
    /// The retina of `[retina]`, or the one that the encoder brings.
    pub retina: Arc<dyn Retina>,
    /// The encoder of `[encoder]`.
    pub encoder: Arc<dyn Encoder>,
    /// The distance of `[likelihood]`.
    pub distance: distance::Kind,
    /// How sharply a distance counts.
    pub sharpness: Sharpness,
}

impl ObservationSite {
    pub(super) fn new(
        retina: Arc<dyn Retina>,
        encoder: Arc<dyn Encoder>,
        distance: distance::Kind,
        sharpness: Sharpness,
    ) -> Self {
        Self { retina, encoder, distance, sharpness }
    }
}

/// The surroundings of a proposal in a configuration.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct ProposalSite {
    /// The motion model of `[dynamics]`; lengths in template units.
    pub dynamics: Autoregressive,
    /// Whether the target's centre stays in the picture.
    pub clamp_to_frame: bool,
}

impl ProposalSite {
    pub(super) fn new(dynamics: Autoregressive, clamp_to_frame: bool) -> Self {
        Self { dynamics, clamp_to_frame }
    }
}

impl Parts {
    /// No components beside those of the library.
    pub fn new() -> Self {
        Self::default()
    }
    /// Adds a gaze policy, for `policy.kind`.
    ///
    /// # Panics
    /// If the library or these components have a policy of this name.
    pub fn with_policy<S: DeserializeOwned, P: Policy + 'static>(
        mut self,
        name: &str,
        make: impl Fn(S) -> Result<P> + Send + Sync + 'static,
    ) -> Self {
        let make = move |part: &OwnPart| Ok(Box::new(make(part.settings("policy")?)?) as Box<dyn Policy>);
        self.policies.add(&POLICIES, name, Arc::new(make));
        self
    }
    /// Adds an encoder, for `encoder.kind`. The constructor returns the encoder with the retina whose glimpses it reads: that of
    /// the configuration ([`EncoderSite::retina`]), or its own.
    ///
    /// # Panics
    /// If the library or these components have an encoder of this name.
    pub fn with_encoder<S: DeserializeOwned, E: Encoder + 'static>(
        mut self,
        name: &str,
        make: impl Fn(S, &EncoderSite<'_>) -> Result<(Foveal, E)> + Send + Sync + 'static,
    ) -> Self {
        let make = move |part: &OwnPart, site: &EncoderSite<'_>| {
            let (retina, encoder) = make(part.settings("encoder")?, site)?;
            Ok((retina, Arc::new(encoder) as Arc<dyn Encoder>))
        };
        self.encoders.add(&ENCODERS, name, Arc::new(make));
        self
    }
    /// Adds an observation model, for `observation_model.kind`. It takes the place of retina, encoder and distance.
    ///
    /// # Panics
    /// If these components have an observation model of this name.
    pub fn with_observation_model<S: DeserializeOwned, A: Appearance + 'static>(
        mut self,
        name: &str,
        make: impl Fn(S, ObservationSite) -> Result<A> + Send + Sync + 'static,
    ) -> Self {
        let make = move |part: &OwnPart, site: ObservationSite| {
            Ok(Box::new(make(part.settings("observation_model")?, site)?) as Box<dyn Appearance>)
        };
        self.observation_models.add(&[], name, Arc::new(make));
        self
    }
    /// Adds a proposal, for `proposal.kind`.
    ///
    /// # Panics
    /// If the library or these components have a proposal of this name.
    pub fn with_proposal<S: DeserializeOwned, P: Proposal + 'static>(
        mut self,
        name: &str,
        make: impl Fn(S, ProposalSite) -> Result<P> + Send + Sync + 'static,
    ) -> Self {
        let make = move |part: &OwnPart, site: ProposalSite| {
            Ok(Box::new(make(part.settings("proposal")?, site)?) as Box<dyn Proposal>)
        };
        self.proposals.add(&PROPOSALS, name, Arc::new(make));
        self
    }
    /// Adds a detector, for `detector.kind`. The constructor is called once for each video.
    ///
    /// # Panics
    /// If the library or these components have a detector of this name.
    pub fn with_detector<S: DeserializeOwned, D: Detector + 'static>(
        mut self,
        name: &str,
        make: impl Fn(S) -> Result<D> + Send + Sync + 'static,
    ) -> Self {
        let make = move |part: &OwnPart| Ok(Box::new(make(part.settings("detector")?)?) as Box<dyn Detector>);
        self.detectors.add(&DETECTORS, name, Arc::new(make));
        self
    }
    /// Adds a reward, for `reward.kind`.
    ///
    /// # Panics
    /// If the library or these components have a reward of this name.
    pub fn with_reward<S: DeserializeOwned, R: Reward + 'static>(
        mut self,
        name: &str,
        make: impl Fn(S) -> Result<R> + Send + Sync + 'static,
    ) -> Self {
        let make = move |part: &OwnPart| Ok(Box::new(make(part.settings("reward")?)?) as Box<dyn Reward>);
        self.rewards.add(&REWARDS, name, Arc::new(make));
        self
    }

    pub(super) fn policy(&self, part: &OwnPart) -> Result<Box<dyn Policy>> {
        self.policies.of("policy", part)?(part)
    }
    pub(super) fn encoder(&self, part: &OwnPart, site: &EncoderSite<'_>) -> Result<(Foveal, Arc<dyn Encoder>)> {
        self.encoders.of("encoder", part)?(part, site)
    }
    pub(super) fn observation_model(&self, part: &OwnPart, site: ObservationSite) -> Result<Box<dyn Appearance>> {
        self.observation_models.of("observation_model", part)?(part, site)
    }
    pub(super) fn proposal(&self, part: &OwnPart, site: ProposalSite) -> Result<Box<dyn Proposal>> {
        self.proposals.of("proposal", part)?(part, site)
    }
    pub(super) fn detector(&self, part: &OwnPart) -> Result<Box<dyn Detector>> {
        self.detectors.of("detector", part)?(part)
    }
    pub(super) fn reward(&self, part: &OwnPart) -> Result<Box<dyn Reward>> {
        self.rewards.of("reward", part)?(part)
    }
    /// The registered names of a section.
    pub(super) fn names(&self, section: &str) -> Vec<&str> {
        match section {
            "policy" => self.policies.names(),
            "encoder" => self.encoders.names(),
            "observation_model" => self.observation_models.names(),
            "proposal" => self.proposals.names(),
            "detector" => self.detectors.names(),
            "reward" => self.rewards.names(),
            _ => vec![],
        }
    }
    fn all(&self) -> [(&'static str, Vec<&str>); 6] {
        ["policy", "encoder", "observation_model", "proposal", "detector", "reward"].map(|it| (it, self.names(it)))
    }
}

/// The registered names.
impl fmt::Debug for Parts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let some = self.all().into_iter().filter(|(_, names)| !names.is_empty());
        f.write_str("Parts ")?;
        f.debug_map().entries(some).finish()
    }
}

/// Whether the registered names are the same: constructors cannot be compared.
impl PartialEq for Parts {
    fn eq(&self, other: &Self) -> bool {
        self.all() == other.all()
    }
}

impl fmt::Debug for EncoderSite<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("EncoderSite").field("given", &self.given).field("folder", &self.folder).finish_non_exhaustive()
    }
}

impl fmt::Debug for ObservationSite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let site = (&self.distance, &self.sharpness, self.encoder.shape());
        f.debug_tuple("ObservationSite").field(&site).finish()
    }
}

/// Constructors by name.
struct Named<F: ?Sized>(BTreeMap<String, Arc<F>>);

impl<F: ?Sized> Named<F> {
    fn add(&mut self, builtin: &[&str], name: &str, make: Arc<F>) {
        assert!(!builtin.contains(&name), "`{name}` is a part of the library: choose another name");
        let before = self.0.insert(name.to_owned(), make);
        assert!(before.is_none(), "`{name}` is registered twice");
    }
    fn of(&self, section: &str, part: &OwnPart) -> Result<&F> {
        self.0.get(part.kind()).map(|make| &**make).ok_or_else(|| {
            Error::Config(format!("{section}.kind: `{}` is not registered in the configuration's parts", part.kind()))
        })
    }
    fn names(&self) -> Vec<&str> {
        self.0.keys().map(String::as_str).collect()
    }
}

impl<F: ?Sized> Clone for Named<F> {
    fn clone(&self) -> Self {
        Self(self.0.clone())
    }
}

impl<F: ?Sized> Default for Named<F> {
    fn default() -> Self {
        Self(BTreeMap::new())
    }
}
