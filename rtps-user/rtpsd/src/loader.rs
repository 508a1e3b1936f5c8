//! Loads the low-level layer into the kernel, or takes over what an earlier rtpsd left pinned there.
//!
//! Maps are reused when they are what this build would make; programs are always loaded anew and replace the ones
//! on the pinned links in one step, so that no datagram passes unseen in between.

mod classifier;

use std::collections::BTreeMap;
use std::fmt;

use anyhow::{Context, Result, anyhow, bail};
use aya::maps::{MapData, MapInfo};
use aya::programs::links::{FdLink, PinnedLink};
use aya::programs::xdp::XdpLink;
use aya::programs::{Program, SocketFilter, Xdp, XdpMode};
use aya::{Ebpf, EbpfLoader};
use rtps_ebpf::OBJECT;
use rtps_ebpf::abi::name;
use rtps_net::Interface;
use serde::{Deserialize, Serialize};
use tracing::{debug, info, warn};

use self::classifier::Classifiers;
use crate::pins::{Hook, PinFolder};
use crate::run_folder::remove_if_there;

/// Which XDP mode is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum WantedMode {
    /// Native where the driver can, else generic.
    #[default]
    Auto,
    /// Run by the driver, before the kernel allocates anything; an error where it cannot.
    Native,
    /// Run by the network stack; works on every interface.
    Generic,
}

/// The XDP mode that took effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AttachedMode {
    /// Run by the driver.
    Native,
    /// Run by the network stack.
    Generic,
}

impl WantedMode {
    /// What to try, in this order.
    fn attempts(self) -> &'static [AttachedMode] {
        match self {
            Self::Auto => &[AttachedMode::Native, AttachedMode::Generic],
            Self::Native => &[AttachedMode::Native],
            Self::Generic => &[AttachedMode::Generic],
        }
    }
}

impl AttachedMode {
    /// Its name in pins, JSON and logs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Native => "native",
            Self::Generic => "generic",
        }
    }

    fn flags(self) -> XdpMode {
        match self {
            Self::Native => XdpMode::Driver,
            Self::Generic => XdpMode::Skb,
        }
    }
}

impl fmt::Display for AttachedMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The loaded programs. Dropping it leaves everything that is pinned in place.
pub(crate) struct Loader {
    folder: PinFolder,
    ebpf: Ebpf,
    classifiers: Classifiers,
}

impl Loader {
    /// Loads the programs over pinned maps, which are made where missing, and pins the programs.
    pub(crate) fn load(folder: PinFolder) -> Result<Self> {
        check_pinned_maps(&folder)?;
        let mut loader = EbpfLoader::new();
        for map in name::MAPS {
            loader.map_pin_path(map, folder.entry(map));
        }
        let mut ebpf = loader
            .load(OBJECT)
            .context("the kernel does not take the layer's maps; Linux 5.19 or newer is needed")?;
        xdp_program(&mut ebpf)?
            .load()
            .context("the kernel's verifier refuses the XDP program")?;
        filter_program(&mut ebpf)?
            .load()
            .context("the kernel's verifier refuses the socket filter")?;
        let mut loaded = Self {
            folder,
            classifiers: Classifiers::load(&mut ebpf),
            ebpf,
        };
        loaded.pin_programs()?;
        Ok(loaded)
    }

    /// The filter for the layer's own sockets.
    pub(crate) fn filter(&mut self) -> Result<&SocketFilter> {
        Ok(filter_program(&mut self.ebpf)?)
    }

    /// Attaches XDP to an interface, or replaces the program of an earlier rtpsd there, and says in which mode.
    pub(crate) fn attach(
        &mut self,
        interface: &Interface,
        wanted: WantedMode,
    ) -> Result<AttachedMode> {
        for &mode in wanted.attempts() {
            if self.take_over(interface, mode) {
                return Ok(mode);
            }
        }
        self.detach_where(|index, hook| index == interface.index && matches!(hook, Hook::Xdp(_)))?;
        let mut refusals = Vec::new();
        for &mode in wanted.attempts() {
            match self.attach_new(interface, mode) {
                Ok(()) => return Ok(mode),
                Err(error) => {
                    debug!(interface = interface.name, %mode, "{error:#}");
                    refusals.push(format!("{mode}: {error:#}"));
                }
            }
        }
        bail!(
            "XDP cannot be attached to `{}` ({}); if another XDP program is there, `ip link set dev {} xdp off` \
             removes it",
            interface.name,
            refusals.join("; "),
            interface.name
        )
    }

    /// Detaches what an earlier rtpsd had attached to interfaces that are no longer asked for.
    pub(crate) fn detach_others(&self, interfaces: &[Interface]) -> Result<()> {
        self.detach_where(|index, hook| {
            hook != Hook::FanOut && interfaces.iter().all(|known| known.index != index)
        })
    }

    fn detach_where(&self, unwanted: impl Fn(u32, Hook) -> bool) -> Result<()> {
        for link in self.folder.links()? {
            if unwanted(link.interface_index, link.hook) {
                remove_if_there(&link.path)?;
            }
        }
        Ok(())
    }

    /// Replaces the program on a pinned link; false when there is no such link, or its interface is gone.
    fn take_over(&mut self, interface: &Interface, mode: AttachedMode) -> bool {
        let Ok(pinned) = PinnedLink::from_pin(self.folder.link(interface.index, Hook::Xdp(mode)))
        else {
            return false;
        };
        match self.replace_program(pinned) {
            Ok(()) => {
                info!(interface = interface.name, %mode, "took over the attached XDP program");
                true
            }
            Err(error) => {
                warn!(
                    interface = interface.name,
                    "the pinned XDP link is dead: {error:#}"
                );
                false
            }
        }
    }

    fn replace_program(&mut self, pinned: PinnedLink) -> Result<()> {
        let link = XdpLink::try_from(FdLink::from(pinned))?;
        let xdp = xdp_program(&mut self.ebpf)?;
        let id = xdp.attach_to_link(link)?;
        // Only the pin holds the link, so that removing the pin detaches.
        drop(FdLink::try_from(xdp.take_link(id)?)?);
        Ok(())
    }

    fn attach_new(&mut self, interface: &Interface, mode: AttachedMode) -> Result<()> {
        let path = self.folder.link(interface.index, Hook::Xdp(mode));
        let xdp = xdp_program(&mut self.ebpf)?;
        let id = xdp
            .attach_to_if_index(interface.index, mode.flags())
            .map_err(|error| anyhow!(innermost(&error)))?;
        let link = xdp.take_link(id)?;
        FdLink::try_from(link)
            .context("the kernel has no XDP links; Linux 5.19 or newer is needed")?
            .pin(path)
            .context("cannot pin the XDP link")?;
        Ok(())
    }

    fn pin_programs(&mut self) -> Result<()> {
        let mut programs = vec![name::XDP_PROGRAM, name::FILTER_PROGRAM];
        programs.extend(self.classifiers.loaded());
        for program in programs {
            let path = self.folder.entry(program);
            remove_if_there(&path)?;
            self.ebpf
                .program_mut(program)
                .with_context(|| format!("the object has no program `{program}`"))?
                .pin(&path)
                .with_context(|| format!("cannot pin {}", path.display()))?;
        }
        Ok(())
    }
}

/// aya's errors name the call at the top and the reason at the bottom.
fn innermost(error: &dyn std::error::Error) -> String {
    let mut innermost = error;
    while let Some(source) = innermost.source() {
        innermost = source;
    }
    innermost.to_string()
}

fn xdp_program(ebpf: &mut Ebpf) -> Result<&mut Xdp> {
    program(ebpf, name::XDP_PROGRAM)
}

fn filter_program(ebpf: &mut Ebpf) -> Result<&mut SocketFilter> {
    program(ebpf, name::FILTER_PROGRAM)
}

fn program<'a, P>(ebpf: &'a mut Ebpf, name: &str) -> Result<&'a mut P>
where
    &'a mut P: TryFrom<&'a mut Program>,
{
    ebpf.program_mut(name)
        .and_then(|program| program.try_into().ok())
        .with_context(|| format!("the object has no program `{name}` of the right kind"))
}

/// The properties in which a pinned map must equal the one that this build would make.
#[derive(Debug, PartialEq, Eq)]
struct Shape {
    kind: u32,
    key_size: u32,
    value_size: u32,
    max_entries: u32,
}

/// aya reuses whatever is pinned under a map's name; so this looks first.
fn check_pinned_maps(folder: &PinFolder) -> Result<()> {
    let object = aya_obj::Object::parse(OBJECT).context("the embedded object is broken")?;
    let expected: BTreeMap<&str, Shape> = object
        .maps
        .iter()
        .map(|(name, map)| (name.as_str(), shape_of_definition(map)))
        .collect();
    for map in name::MAPS {
        let path = folder.entry(map);
        if !path.exists() {
            continue;
        }
        let info = MapData::from_pin(&path)
            .and_then(|data| data.info())
            .with_context(|| format!("{} is no map", path.display()))?;
        let found = shape_of_pinned(&info)?;
        if expected.get(map) != Some(&found) {
            bail!(
                "the pinned map {} was made by another build of rtpsd; remove its leftovers with \
                 `cargo xtask unload`, then load again",
                path.display()
            );
        }
    }
    Ok(())
}

fn shape_of_definition(map: &aya_obj::Map) -> Shape {
    Shape {
        kind: map.map_type(),
        key_size: map.key_size(),
        value_size: map.value_size(),
        max_entries: map.max_entries(),
    }
}

fn shape_of_pinned(info: &MapInfo) -> Result<Shape> {
    Ok(Shape {
        kind: info.map_type()? as u32,
        key_size: info.key_size(),
        value_size: info.value_size(),
        max_entries: info.max_entries(),
    })
}
