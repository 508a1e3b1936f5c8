//! Loads the low-level layer into the kernel, or takes over what an earlier rtpsd left pinned there.
//!
//! Maps are reused when they are what this build would make; programs are always loaded anew and replace the ones
//! on the pinned links in one step, so that no datagram passes unseen in between.

mod classifier;
mod mode;
mod xdp;

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use aya::maps::{MapData, MapInfo};
use aya::programs::{Program, SocketFilter};
use aya::{Ebpf, EbpfLoader};
use rtps_ebpf::OBJECT;
use rtps_ebpf::abi::name;
use rtps_net::Interface;

use self::classifier::Classifiers;
pub use self::mode::{AttachedMode, WantedMode};
pub(crate) use self::xdp::XdpHook;
use crate::pins::{Hook, PinFolder};
use crate::run_folder::remove_if_there;

/// A link is detached a moment after its pin is gone.
const DETACHED_WITHIN: Duration = Duration::from_secs(3);

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
        xdp::load(&mut ebpf)?;
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

    /// Has messages for apps taken from an interface, by the programs of an earlier rtpsd if they are there, and says in
    /// which mode.
    pub(crate) fn attach(
        &mut self,
        interface: &Interface,
        wanted: WantedMode,
    ) -> Result<AttachedMode> {
        let attempts = wanted.attempts(interface);
        let mut refusals = Vec::new();
        for &mode in attempts {
            match mode.xdp() {
                Some(hook) if self.take_over_xdp(interface, hook) => return Ok(mode),
                Some(_) => {}
                None => match self.attach_classifier(interface) {
                    Ok(()) => {
                        self.detach_xdp(interface)?;
                        return Ok(mode);
                    }
                    Err(reason) => refusals.push(format!("{mode}: {reason}")),
                },
            }
        }
        let patience = if self.detach_xdp(interface)? {
            DETACHED_WITHIN
        } else {
            Duration::ZERO
        };
        let end = Instant::now() + patience;
        for &mode in attempts {
            match mode
                .xdp()
                .map(|hook| self.attach_xdp_until(interface, hook, end))
            {
                Some(Ok(())) => return Ok(mode),
                Some(Err(error)) => refusals.push(format!("{mode}: {error:#}")),
                None => {}
            }
        }
        bail!(
            "the programs cannot be attached to `{}` ({}); if another XDP program is there, `ip link set dev {} xdp off` \
             removes it",
            interface.name,
            refusals.join("; "),
            interface.name
        )
    }

    /// Detaches what an earlier rtpsd had attached to interfaces that are no longer asked for.
    pub(crate) fn detach_others(&self, interfaces: &[Interface]) -> Result<()> {
        let is_other = |index| interfaces.iter().all(|known| known.index != index);
        self.detach_where(|index, hook| hook != Hook::FanOut && is_other(index))
            .map(drop)
    }

    /// Says whether there was anything.
    fn detach_where(&self, unwanted: impl Fn(u32, Hook) -> bool) -> Result<bool> {
        let mut links = self.folder.links()?;
        links.retain(|link| unwanted(link.interface_index, link.hook));
        for link in &links {
            remove_if_there(&link.path)?;
        }
        Ok(!links.is_empty())
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
