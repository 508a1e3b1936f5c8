//! What rtpsd itself keeps in pinned maps, so that it can be killed and started again unnoticed.
//!
//! `identity` has one entry for each domain: who the host is there. `store-<domain>` has the records that the
//! domain's [`Layer`](rtps_user::layer::Layer) wants kept; a value is its length (4 bytes, host order), the bytes,
//! and padding.

use std::collections::BTreeSet;

use anyhow::{Context, Result, bail};
use aya::maps::{HashMap, Map, MapData, MapError};
use aya_obj::generated::BPF_F_NO_PREALLOC;
use nix::errno::Errno;
use rtps_ebpf::abi;
use rtps_user::layer::{MAX_STORE_VALUE, StoreChange, StoreKey};
use rtps_user::wire::GuidPrefix;

use crate::kernel_maps::{create, ignore_missing, monotonic_now, nanoseconds};
use crate::pins::PinFolder;
use crate::run_folder::remove_if_there;

const IDENTITY: &str = "identity";

/// Records of one domain.
const MAX_RECORDS: u32 = 65_536;

/// Bytes of a value: length and content.
const VALUE: usize = 4 + MAX_STORE_VALUE;

const HASH: u32 = aya_obj::generated::bpf_map_type::BPF_MAP_TYPE_HASH as u32;

/// Who the host is in one domain, as long as its pins exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Identity {
    pub(crate) prefix: GuidPrefix,
    /// Index into the `domains` map.
    pub(crate) domain_index: u32,
    /// Decides the unicast ports (RTPS 2.5, 9.6.2.3); `None` before the first start.
    pub(crate) participant_id: Option<u16>,
    /// How often rtpsd has been started with this prefix.
    pub(crate) incarnation: u32,
    /// CLOCK_MONOTONIC, in nanoseconds, when the host became this participant: counts begin there, and so go on after a
    /// restart.
    pub(crate) count_base_ns: u64,
}

/// As the map keeps an [`Identity`].
type Words = [u32; 8];

impl Identity {
    fn to_words(self) -> Words {
        let [a, b, c, d, e, f, g, h, i, j, k, l] = self.prefix.0;
        [
            u32::from_ne_bytes([a, b, c, d]),
            u32::from_ne_bytes([e, f, g, h]),
            u32::from_ne_bytes([i, j, k, l]),
            self.domain_index,
            self.participant_id.map_or(0, |id| u32::from(id) + 1),
            self.incarnation,
            (self.count_base_ns >> 32) as u32,
            self.count_base_ns as u32,
        ]
    }

    fn from_words(words: Words) -> Self {
        let [first, second, third, rest @ ..] = words;
        let [domain_index, participant, incarnation, base_high, base_low] = rest;
        let mut prefix = [0; 12];
        for (bytes, word) in prefix.chunks_exact_mut(4).zip([first, second, third]) {
            bytes.copy_from_slice(&word.to_ne_bytes());
        }
        Self {
            prefix: GuidPrefix(prefix),
            domain_index,
            participant_id: participant
                .checked_sub(1)
                .and_then(|id| u16::try_from(id).ok()),
            incarnation,
            count_base_ns: u64::from(base_high) << 32 | u64::from(base_low),
        }
    }
}

/// The `identity` map.
pub(crate) struct Identities {
    map: HashMap<MapData, u32, Words>,
}

impl Identities {
    /// Opens the map, or makes and pins it.
    pub(crate) fn open(folder: &PinFolder) -> Result<Self> {
        let map = open_or_create(
            folder,
            IDENTITY,
            4,
            size_of::<Words>() as u32,
            abi::DOMAINS,
            0,
        )?;
        Ok(Self { map })
    }

    /// Forgets the domains that are no longer asked for, and their records.
    pub(crate) fn forget_others(
        &mut self,
        folder: &PinFolder,
        domains: &BTreeSet<u32>,
    ) -> Result<()> {
        for (domain, _) in self.all()? {
            if !domains.contains(&domain) {
                remove_if_there(&folder.entry(&store_name(domain)))?;
                ignore_missing(self.map.remove(&domain)).context("map `identity`")?;
            }
        }
        Ok(())
    }

    /// Every domain that is served.
    pub(crate) fn all(&self) -> Result<Vec<(u32, Identity)>> {
        self.map
            .iter()
            .map(|entry| {
                let (domain, words) = entry.context("map `identity`")?;
                Ok((domain, Identity::from_words(words)))
            })
            .collect()
    }

    /// The identity in a domain: the one of before, an incarnation later, or a new one with `new_prefix`.
    pub(crate) fn begin(&mut self, domain: u32, new_prefix: GuidPrefix) -> Result<Identity> {
        let all = self.all()?;
        if let Some((_, known)) = all.iter().find(|(id, _)| *id == domain) {
            let identity = Identity {
                incarnation: known.incarnation.wrapping_add(1),
                ..*known
            };
            self.keep(domain, identity)?;
            return Ok(identity);
        }
        let taken = |index: &u32| all.iter().any(|(_, other)| other.domain_index == *index);
        let Some(domain_index) = (0..abi::DOMAINS).find(|index| !taken(index)) else {
            bail!("a layer serves at most {} domains", abi::DOMAINS);
        };
        let identity = Identity {
            prefix: new_prefix,
            domain_index,
            participant_id: None,
            incarnation: 1,
            count_base_ns: nanoseconds(monotonic_now()),
        };
        self.keep(domain, identity)?;
        Ok(identity)
    }

    /// Writes a changed identity.
    pub(crate) fn keep(&mut self, domain: u32, identity: Identity) -> Result<()> {
        self.map
            .insert(domain, identity.to_words(), 0)
            .context("map `identity`")
    }
}

/// The records of one domain's layer.
pub(crate) struct Store {
    map: HashMap<MapData, [u8; 32], [u8; VALUE]>,
}

impl Store {
    /// Opens the domain's map, or makes and pins it. Memory is taken as records come.
    pub(crate) fn open(folder: &PinFolder, domain: u32) -> Result<Self> {
        let map = open_or_create(
            folder,
            &store_name(domain),
            32,
            VALUE as u32,
            MAX_RECORDS,
            BPF_F_NO_PREALLOC,
        )?;
        Ok(Self { map })
    }

    /// Does what the layer wants.
    pub(crate) fn apply(&mut self, change: &StoreChange) -> Result<()> {
        match change {
            StoreChange::Store { key, value } => {
                let value = pad(value).with_context(|| {
                    format!("a record of {} bytes is too long to keep", value.len())
                })?;
                self.insert(key.0, &value).context("map `store`")
            }
            StoreChange::Forget(key) => {
                ignore_missing(self.map.remove(&key.0)).context("map `store`")
            }
        }
    }

    /// The kernel refills its per-CPU reserve of elements right after it ran out of them, so a second attempt
    /// succeeds unless memory is really short.
    fn insert(&mut self, key: [u8; 32], value: &[u8; VALUE]) -> Result<(), MapError> {
        const ATTEMPTS: u32 = 8;
        for _ in 1..ATTEMPTS {
            match self.map.insert(key, value, 0) {
                Err(MapError::SyscallError(error))
                    if error.io_error.raw_os_error() == Some(Errno::ENOMEM as i32) =>
                {
                    std::thread::yield_now();
                }
                other => return other,
            }
        }
        self.map.insert(key, value, 0)
    }

    /// Every record; one that is broken is left out.
    pub(crate) fn records(&self) -> Vec<(StoreKey, Vec<u8>)> {
        self.map
            .iter()
            .filter_map(Result::ok)
            .filter_map(|(key, value)| Some((StoreKey(key), unpad(&value)?.to_vec())))
            .collect()
    }
}

fn store_name(domain: u32) -> String {
    format!("store-{domain}")
}

fn pad(content: &[u8]) -> Option<[u8; VALUE]> {
    let mut value = [0; VALUE];
    let (length, rest) = value.split_first_chunk_mut::<4>()?;
    *length = u32::try_from(content.len()).ok()?.to_ne_bytes();
    rest.get_mut(..content.len())?.copy_from_slice(content);
    Some(value)
}

fn unpad(value: &[u8; VALUE]) -> Option<&[u8]> {
    let (length, rest) = value.split_first_chunk::<4>()?;
    rest.get(..usize::try_from(u32::from_ne_bytes(*length)).ok()?)
}

fn open_or_create<K: aya::Pod, V: aya::Pod>(
    folder: &PinFolder,
    name: &str,
    key_size: u32,
    value_size: u32,
    max_entries: u32,
    flags: u32,
) -> Result<HashMap<MapData, K, V>> {
    let path = folder.entry(name);
    let data = if path.exists() {
        MapData::from_pin(&path).with_context(|| format!("cannot open {}", path.display()))?
    } else {
        let kernel_name = format!("rtps_{}", name.replace('-', "_"));
        let data = create(HASH, key_size, value_size, max_entries, flags, &kernel_name)?;
        data.pin(&path)
            .with_context(|| format!("cannot pin {}", path.display()))?;
        data
    };
    HashMap::try_from(Map::from_map_data(data)?).with_context(|| {
        format!(
            "the pinned map {} was made by another build of rtpsd; remove its leftovers with \
             `cargo xtask unload`, then load again",
            path.display()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identity_survives_the_map() {
        for participant_id in [None, Some(0), Some(119)] {
            let identity = Identity {
                prefix: GuidPrefix([1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]),
                domain_index: 3,
                participant_id,
                incarnation: 9,
                count_base_ns: 0x0123_4567_89ab_cdef,
            };
            assert_eq!(Identity::from_words(identity.to_words()), identity);
        }
    }

    #[test]
    fn records_keep_their_length() {
        for length in [0, 1, MAX_STORE_VALUE] {
            let content = vec![7; length];
            assert_eq!(unpad(&pad(&content).unwrap()), Some(content.as_slice()));
        }
        assert!(pad(&vec![7; MAX_STORE_VALUE + 1]).is_none());
        let mut lying = pad(&[1]).unwrap();
        lying[..4].copy_from_slice(&u32::MAX.to_ne_bytes());
        assert_eq!(unpad(&lying), None);
    }
}
