//! What can be done to a packet that a process of this host sends.

use aya_ebpf::{
    bindings::BPF_F_PSEUDO_HDR,
    helpers::{
        bpf_get_socket_cookie, bpf_l3_csum_replace, bpf_l4_csum_replace, bpf_redirect_neigh,
        bpf_skb_store_bytes,
    },
};
use rtps_ebpf::{
    Bytes as _,
    abi::Destination,
    frame::{IPV4_CHECKSUM, IPV4_SOURCE, UDP_CHECKSUM, UDP_DESTINATION},
};

use super::{buffer::LinkBuffer, succeed};

const ETHERTYPE_IPV4: u16 = 0x0800;
const TWO_BYTES: u64 = 2;
const FOUR_BYTES: u64 = 4;

impl LinkBuffer {
    /// Whether it is an IPv4 packet, as far as the kernel knows.
    #[inline(always)]
    pub(crate) fn is_ipv4(&self) -> bool {
        // SAFETY: the context is the program's own.
        u16::from_be(unsafe { (*self.context).protocol } as u16) == ETHERTYPE_IPV4
    }

    /// Bytes of payload in each of several datagrams in one (GSO); 0 for a single one.
    #[inline(always)]
    pub(crate) fn segment(&self) -> u32 {
        // SAFETY: the context is the program's own.
        unsafe { (*self.context).gso_size }
    }

    /// Of the socket that it comes from; 0 where there is none.
    #[inline(always)]
    pub(crate) fn socket_cookie(&self) -> u64 {
        // SAFETY: the context is the program's own.
        unsafe { bpf_get_socket_cookie(self.context.cast()) }
    }

    /// Gives a UDP packet over IPv4 other addresses, and another destination port. The checksums follow, whether
    /// the link has still to complete that of UDP or not.
    #[inline(always)]
    pub(crate) fn readdress(&self, ip: u32, udp: u32, to: &Destination) -> Result<(), ()> {
        let [s0, s1, s2, s3] = to.source;
        let [d0, d1, d2, d3] = to.address;
        let [p0, p1] = (to.port as u16).to_be_bytes();
        let addresses = self.load::<8>(ip + IPV4_SOURCE).ok_or(())?;
        let port = self.load::<2>(udp + UDP_DESTINATION).ok_or(())?;
        let [a0, a1, a2, a3, b0, b1, b2, b3] = addresses;
        self.replace_address(ip, udp, [a0, a1, a2, a3], to.source)?;
        self.replace_address(ip, udp, [b0, b1, b2, b3], to.address)?;
        let (before, after) = (u16::from_ne_bytes(port), u16::from_ne_bytes([p0, p1]));
        // SAFETY: the context is the program's own; the helper checks the offset.
        succeed(unsafe {
            let checksum = udp + UDP_CHECKSUM;
            bpf_l4_csum_replace(
                self.context,
                checksum,
                before.into(),
                after.into(),
                TWO_BYTES,
            )
        })?;
        self.overwrite(ip + IPV4_SOURCE, &[s0, s1, s2, s3, d0, d1, d2, d3])?;
        self.overwrite(udp + UDP_DESTINATION, &[p0, p1])
    }

    /// Has both checksums follow the change of an address.
    #[inline(always)]
    fn replace_address(
        &self,
        ip: u32,
        udp: u32,
        before: [u8; 4],
        after: [u8; 4],
    ) -> Result<(), ()> {
        let (before, after) = (u32::from_ne_bytes(before), u32::from_ne_bytes(after));
        let (before, after) = (before.into(), after.into());
        let in_pseudo_header = u64::from(BPF_F_PSEUDO_HDR) | FOUR_BYTES;
        // SAFETY: the context is the program's own; the helpers check the offsets.
        unsafe {
            let checksum = ip + IPV4_CHECKSUM;
            succeed(bpf_l3_csum_replace(
                self.context,
                checksum,
                before,
                after,
                FOUR_BYTES,
            ))?;
            let checksum = udp + UDP_CHECKSUM;
            succeed(bpf_l4_csum_replace(
                self.context,
                checksum,
                before,
                after,
                in_pseudo_header,
            ))
        }
    }

    /// Overwrites bytes whose checksum has been seen to.
    #[inline(always)]
    fn overwrite<const N: usize>(&self, offset: u32, bytes: &[u8; N]) -> Result<(), ()> {
        // SAFETY: the helper reads the `N` bytes that it is given, and fails beyond the frame.
        succeed(unsafe {
            bpf_skb_store_bytes(self.context, offset, bytes.as_ptr().cast(), N as u32, 0)
        })
    }

    /// The verdict that sends the packet out of an interface, to the neighbour that leads to its destination.
    #[inline(always)]
    pub(crate) fn hand_to_neighbour(&self, ifindex: u32) -> i32 {
        // SAFETY: without a next hop of ours, the kernel looks it up itself.
        unsafe { bpf_redirect_neigh(ifindex, core::ptr::null_mut(), 0, 0) as i32 }
    }
}
