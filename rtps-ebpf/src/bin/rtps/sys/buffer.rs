//! Socket buffers: datagrams at a UDP socket, and frames at the tc hook, which can be turned into
//! answers.

use core::{ffi::c_void, mem::MaybeUninit};

use aya_ebpf::{
    EbpfContext as _,
    bindings::{__sk_buff, BPF_F_RECOMPUTE_CSUM, bpf_hdr_start_off::BPF_HDR_START_NET},
    check_bounds_signed,
    helpers::{
        bpf_clone_redirect, bpf_l3_csum_replace, bpf_l4_csum_replace, bpf_skb_change_tail,
        bpf_skb_load_bytes, bpf_skb_load_bytes_relative, bpf_skb_store_bytes,
    },
    programs::{SkBuffContext, TcContext},
};
use rtps_ebpf::{Bytes, frame::UDP_LEN};

use super::{
    Overwrite,
    message::{self, Message, Packet},
    succeed,
};

/// `PACKET_HOST` of linux/if_packet.h: addressed to this host's interface.
const PACKET_HOST: u32 = 0;
/// `PACKET_MULTICAST`.
const PACKET_MULTICAST: u32 = 2;

/// A datagram at a UDP socket: data begins at the UDP header, after reassembly.
pub(crate) struct SocketBuffer {
    context: *mut __sk_buff,
    len: u32,
}

impl SocketBuffer {
    #[inline(always)]
    pub(crate) fn new(context: &SkBuffContext) -> Self {
        Self {
            context: context.as_ptr().cast(),
            len: context.len(),
        }
    }

    #[inline(always)]
    pub(crate) fn ifindex(&self) -> u32 {
        // SAFETY: the context is the program's own.
        unsafe { (*self.context).ifindex }
    }

    /// The ethertype, in host order.
    #[inline(always)]
    pub(crate) fn protocol(&self) -> u16 {
        // SAFETY: the context is the program's own.
        u16::from_be(unsafe { (*self.context).protocol } as u16)
    }

    /// What the tc program has marked it with.
    #[inline(always)]
    pub(crate) fn mark(&self) -> u16 {
        // SAFETY: the context is the program's own.
        unsafe { (*self.context).tc_index as u16 }
    }

    /// Reads from the IP header.
    #[inline(always)]
    pub(crate) fn load_network<const N: usize>(&self, offset: u32) -> Option<[u8; N]> {
        let mut bytes = MaybeUninit::<[u8; N]>::uninit();
        let to = bytes.as_mut_ptr().cast();
        // SAFETY: the helper writes all `N` bytes, or fails, which is asked first.
        unsafe {
            let context = self.context.cast();
            let result =
                bpf_skb_load_bytes_relative(context, offset, to, N as u32, BPF_HDR_START_NET);
            (result == 0).then(|| bytes.assume_init())
        }
    }

    /// The payload: an RTPS message.
    #[inline(always)]
    pub(crate) fn message(&self) -> Message<*mut __sk_buff> {
        Message::new(self.context, UDP_LEN, self.len.saturating_sub(UDP_LEN))
    }
}

impl Bytes for SocketBuffer {
    #[inline(always)]
    fn len(&self) -> u32 {
        self.len
    }

    #[inline(always)]
    fn load<const N: usize>(&self, offset: u32) -> Option<[u8; N]> {
        message::load(self.context, offset)
    }
}

/// A frame at the tc hook: data begins at the Ethernet header, without the outer VLAN tag.
pub(crate) struct LinkBuffer {
    pub(super) context: *mut __sk_buff,
    len: u32,
}

impl LinkBuffer {
    #[inline(always)]
    pub(crate) fn new(context: &TcContext) -> Self {
        Self {
            context: context.as_ptr().cast(),
            len: context.len(),
        }
    }

    #[inline(always)]
    pub(crate) fn ifindex(&self) -> u32 {
        // SAFETY: the context is the program's own.
        unsafe { (*self.context).ifindex }
    }

    /// Whether it came from the link, for this host: not looped back, not overheard.
    #[inline(always)]
    pub(crate) fn is_for_this_host(&self) -> bool {
        // SAFETY: the context is the program's own.
        let kind = unsafe { (*self.context).pkt_type };
        kind == PACKET_HOST || kind == PACKET_MULTICAST
    }

    /// Whether it came with a VLAN tag, which an answer will have, too.
    #[inline(always)]
    pub(crate) fn has_vlan_tag(&self) -> bool {
        // SAFETY: the context is the program's own.
        unsafe { (*self.context).vlan_present != 0 }
    }

    /// Leaves a mark that the socket filter sees. It is the class that packet classifiers choose, which
    /// nobody looks at behind ingress.
    #[inline(always)]
    pub(crate) fn set_mark(&self, mark: u16) {
        // SAFETY: the context is the program's own. The kernel takes the second for the first when a
        // later program on the hook decides to pass the frame.
        unsafe {
            (*self.context).tc_index = mark.into();
            (*self.context).tc_classid = mark.into();
        }
    }

    /// The part of the frame that holds an RTPS message.
    #[inline(always)]
    pub(crate) fn message(&self, start: u32, len: u32) -> Message<*mut __sk_buff> {
        Message::new(self.context, start, len)
    }

    /// Copies the whole frame; fails when it is longer than `to`.
    #[inline(always)]
    pub(crate) fn copy_whole<const N: usize>(&self, to: &mut [u8; N]) -> Result<(), ()> {
        // SAFETY: `to` has `N` bytes.
        unsafe { self.message(0, self.len).copy(to.as_mut_ptr(), self.len, N) }
    }

    /// Cuts or extends the frame to `len` bytes.
    #[inline(always)]
    pub(crate) fn resize(&self, len: u32) -> Result<(), ()> {
        // SAFETY: the context is the program's own.
        succeed(unsafe { bpf_skb_change_tail(self.context, len, 0) })
    }

    /// Overwrites bytes within the frame.
    #[inline(always)]
    pub(crate) fn store<const N: usize>(&self, offset: u32, bytes: &[u8; N]) -> Result<(), ()> {
        // SAFETY: the helper reads the `N` bytes that it is given, and fails beyond the frame.
        succeed(unsafe {
            let from = bytes.as_ptr().cast();
            bpf_skb_store_bytes(
                self.context,
                offset,
                from,
                N as u32,
                BPF_F_RECOMPUTE_CSUM.into(),
            )
        })
    }

    /// Overwrites bytes within the frame with the first `len` of `bytes`, at least 1.
    #[inline(always)]
    pub(crate) fn store_some(&self, offset: u32, bytes: &[u8], len: u32) -> Result<(), ()> {
        if !check_bounds_signed(i64::from(len), 1, bytes.len() as i64) {
            return Err(());
        }
        // SAFETY: the helper reads `len` bytes, which is at most the length of `bytes`.
        succeed(unsafe {
            let from = bytes.as_ptr().cast();
            bpf_skb_store_bytes(self.context, offset, from, len, BPF_F_RECOMPUTE_CSUM.into())
        })
    }

    /// Overwrites a two-byte field of the IPv4 header, which `checksum` covers.
    #[inline(always)]
    pub(crate) fn store_ipv4(&self, offset: u32, bytes: &[u8; 2], checksum: u32) -> Result<(), ()> {
        let before = message::load::<2>(self.context, offset).ok_or(())?;
        let [from, to] = [before, *bytes].map(|bytes| u16::from_ne_bytes(bytes).into());
        // SAFETY: the context is the program's own; the helper checks the offset.
        succeed(unsafe { bpf_l3_csum_replace(self.context, checksum, from, to, 2) })?;
        self.store(offset, bytes)
    }

    /// Whether the link or its driver has still to complete the checksum at `offset`, as in frames of a
    /// local veth peer. Spoils the checksum otherwise.
    #[inline(always)]
    pub(crate) fn completes_checksum(&self, offset: u32) -> bool {
        const TWO_BYTES: u64 = 2;
        let before = message::load::<2>(self.context, offset);
        // An incomplete checksum does not cover the data yet, so that the helper leaves it as it is.
        // SAFETY: the context is the program's own; the helper checks the offset.
        let added = unsafe { bpf_l4_csum_replace(self.context, offset, 0, 1, TWO_BYTES) };
        added == 0 && before == message::load::<2>(self.context, offset)
    }

    /// Sends a copy of the frame as it is now out of an interface.
    #[inline(always)]
    pub(crate) fn send(&self, ifindex: u32) -> Result<(), ()> {
        // SAFETY: the context is the program's own.
        succeed(unsafe { bpf_clone_redirect(self.context, ifindex, 0) })
    }
}

impl Overwrite for LinkBuffer {
    #[inline(always)]
    fn store_u16(&self, offset: u32, value: u16) -> Result<(), ()> {
        self.store(offset, &value.to_be_bytes())
    }
}

impl Bytes for LinkBuffer {
    #[inline(always)]
    fn len(&self) -> u32 {
        self.len
    }

    #[inline(always)]
    fn load<const N: usize>(&self, offset: u32) -> Option<[u8; N]> {
        message::load(self.context, offset)
    }
}

impl Packet for *mut __sk_buff {
    #[inline(always)]
    unsafe fn read(self, offset: u32, to: *mut c_void, len: u32) -> i64 {
        // SAFETY: as the caller vouches.
        unsafe { bpf_skb_load_bytes(self.cast(), offset, to, len) }
    }
}
