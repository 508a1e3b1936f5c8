//! One named counter for every verdict and reason, kept for each interface.

macro_rules! counters {
    ($($(#[doc = $doc:literal])+ $variant:ident => $name:literal,)+) => {
        /// What the kernel counts; the discriminant is the index into an interface's counters.
        #[repr(u8)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub enum Counter {
            $($(#[doc = $doc])+ $variant,)+
        }

        impl Counter {
            /// Every counter, in the order of its index.
            pub const ALL: &[Self] = &[$(Self::$variant,)+];
            /// How many there are.
            pub const COUNT: usize = Self::ALL.len();

            /// The name in `status --json`.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }
        }
    };
}

counters! {
    /// Passed: the layer is not configured, or by another version.
    PassNotConfigured => "pass_not_configured",
    /// Passed: neither IPv4 nor IPv6 below at most two VLAN tags.
    PassNotIp => "pass_not_ip",
    /// Passed: no UDP, or UDP behind IPv6 extension headers.
    PassNotUdp => "pass_not_udp",
    /// Passed: IP and UDP lengths that contradict each other or the frame.
    PassBadLengths => "pass_bad_lengths",
    /// Passed: an IP fragment; the socket filter sees the whole datagram.
    PassFragment => "pass_fragment",
    /// Passed: multicast or broadcast; the socket filter gets the layer's own copy.
    PassMulticast => "pass_multicast",
    /// Passed: a UDP port that the layer does not own.
    PassNotOurPort => "pass_not_our_port",
    /// Passed: an address that is not this host's, so the packet is on its way elsewhere.
    PassNotOurAddress => "pass_not_our_address",
    /// Passed by XDP: concerns the built-in endpoints, too.
    PassBuiltIn => "pass_built_in",
    /// Passed, not looked into: to the port for discovery.
    PassMetatraffic => "pass_metatraffic",
    /// RTPS messages that XDP looked at.
    XdpMessages => "xdp_messages",
    /// RTPS messages that the tc program took from the stack, and decided on, each of a burst counted.
    IngressMessages => "ingress_messages",
    /// RTPS messages that the socket filter looked at.
    FilterMessages => "filter_messages",
    /// Messages that the socket filter let into rtpsd's socket.
    ToDaemon => "to_daemon",
    /// Messages, or bursts of them in one record, put into the ring of at least one app.
    DeliveredMessages => "delivered_messages",
    /// Records put into rings: one for each message or burst, and app.
    DeliveredRecords => "delivered_records",
    /// Bytes of RTPS messages in those records.
    DeliveredBytes => "delivered_bytes",
    /// Records lost because an app's ring was full.
    LostRingFull => "lost_ring_full",
    /// Records not written because the slot has no app in this domain, or no ring.
    LostNoApp => "lost_no_app",
    /// Sleeping apps woken by the datagram itself.
    DoorbellPacket => "doorbell_packet",
    /// Sleeping apps woken by their ring's notification.
    DoorbellRing => "doorbell_ring",
    /// Dropped: a valid message of which no part concerns anybody here.
    DropUnroutable => "drop_unroutable",
    /// Dropped: addressed by INFO_DST to other participants only.
    DropForeignDestination => "drop_foreign_destination",
    /// Dropped: names a known participant as its sender, but comes from another address.
    DropForeignSource => "drop_foreign_source",
    /// Kept out of rtpsd's socket: the tc program has decided on it.
    DropHandled => "drop_handled",
    /// Kept out of rtpsd's socket: this host's own message, come back.
    DropOwn => "drop_own",
    /// Dropped: malformed before any valid part concerned anybody; the reason is counted as well.
    DropMalformed => "drop_malformed",
    /// Discovery messages that said nothing new, to which rtpsd was not woken.
    DiscoveryQuiet => "discovery_quiet",
    /// Discovery messages of participants that are not known, and did not announce themselves.
    DiscoveryUnknown => "discovery_unknown",
    /// Discovery messages that rtpsd was told.
    DiscoveryNews => "discovery_news",
    /// Discovery messages lost because rtpsd has not read earlier ones; nothing of them is acknowledged.
    LostNewsFull => "lost_news_full",
    /// Participants that the kernel has come to know, and told rtpsd.
    Strangers => "strangers",
    /// Announcements of unknown participants not looked at: too many in all, or from one address.
    BudgetNew => "budget_new",
    /// Messages of strangers that did not count, because they brought too much that is new.
    BudgetNews => "budget_news",
    /// Answers not sent: too many bytes to one participant.
    BudgetPeer => "budget_peer",
    /// Answers not sent: too many bytes to participants that only the kernel knows.
    BudgetStrangers => "budget_strangers",
    /// Answers not sent: too many bytes in all.
    BudgetAll => "budget_all",
    /// Datagrams sent in answer.
    Answers => "answers",
    /// Bytes of RTPS messages in those.
    AnswerBytes => "answer_bytes",
    /// Datagrams in answer that could not be sent.
    LostAnswers => "lost_answers",
    /// Multicast that could not be put back after it was answered, so that nobody else gets it.
    LostOriginal => "lost_original",
    /// Packets that apps sent once for several destinations: a datagram, or a burst of several.
    FanOuts => "fan_outs",
    /// Copies of those sent, one for each destination.
    FanOutCopies => "fan_out_copies",
    /// Copies of those that could not be made.
    LostFanOut => "lost_fan_out",
    /// Refused, and the app told so: for several destinations, but not from an app's socket.
    DropFanOutStranger => "drop_fan_out_stranger",
    /// Refused, and the app told so: for a list of destinations that it does not have.
    DropFanOutUnknown => "drop_fan_out_unknown",
    /// Refused, and the app told so: speaks in another's name, is malformed, or too long for a datagram.
    DropFanOutDenied => "drop_fan_out_denied",
    /// Shorter than an RTPS header.
    TooShort => "malformed_too_short",
    /// Does not begin with "RTPS".
    BadMagic => "malformed_bad_magic",
    /// A major protocol version other than 2.
    BadVersion => "malformed_bad_version",
    /// Fewer bytes left than a submessage header has.
    SubmessageHeader => "malformed_submessage_header",
    /// A submessage longer than the rest of the message.
    SubmessageLength => "malformed_submessage_length",
    /// Length 0 for a submessage that is not the last.
    ZeroLength => "malformed_zero_length",
    /// More submessages than the layer looks at.
    TooManySubmessages => "malformed_too_many_submessages",
    /// A submessage too short for its own fields.
    SubmessageTooShort => "malformed_submessage_too_short",
    /// A number set with more than 256 bits.
    NumberSetBits => "malformed_number_set_bits",
    /// A number set whose bitmap is shorter than its bits.
    NumberSetBitmap => "malformed_number_set_bitmap",
    /// A number set that begins at an invalid number, or runs past the last one.
    NumberSetBase => "malformed_number_set_base",
    /// DATA, DATA_FRAG, NACK_FRAG or HEARTBEAT_FRAG with an invalid sequence number.
    SequenceNumber => "malformed_sequence_number",
    /// HEARTBEAT with an invalid first or last sequence number.
    HeartbeatRange => "malformed_heartbeat_range",
    /// GAP that starts at an invalid sequence number.
    GapStart => "malformed_gap_start",
    /// octetsToInlineQos that points before the end of the fields or beyond the submessage.
    InlineQosOffset => "malformed_inline_qos_offset",
    /// Flags that promise inline QoS or a payload for which there are no bytes, or that
    /// contradict each other.
    Payload => "malformed_payload",
    /// fragmentSize 0 or larger than the sample.
    FragmentSize => "malformed_fragment_size",
    /// No fragment in DATA_FRAG.
    FragmentCount => "malformed_fragment_count",
    /// Fragment number 0.
    FragmentStart => "malformed_fragment_start",
    /// Fragments beyond the end of the sample.
    FragmentRange => "malformed_fragment_range",
    /// Fewer or more bytes than the fragments of a DATA_FRAG have.
    FragmentBytes => "malformed_fragment_bytes",
    /// A locator list longer than its submessage.
    LocatorList => "malformed_locator_list",
}

macro_rules! reasons {
    ($($variant:ident),+ $(,)?) => {
        /// Why a message is malformed; each has its own [`Counter`], under the same name and
        /// with the same discriminant.
        #[repr(u8)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Reason {
            $(
                #[doc = concat!("See [`Counter::", stringify!($variant), "`].")]
                $variant = Counter::$variant as u8,
            )+
        }

        impl Reason {
            /// Every reason.
            pub const ALL: &[Self] = &[$(Self::$variant,)+];

            /// The counter of this reason.
            pub const fn counter(self) -> Counter {
                match self {
                    $(Self::$variant => Counter::$variant,)+
                }
            }
        }
    };
}

reasons!(
    TooShort,
    BadMagic,
    BadVersion,
    SubmessageHeader,
    SubmessageLength,
    ZeroLength,
    TooManySubmessages,
    SubmessageTooShort,
    NumberSetBits,
    NumberSetBitmap,
    NumberSetBase,
    SequenceNumber,
    HeartbeatRange,
    GapStart,
    InlineQosOffset,
    Payload,
    FragmentSize,
    FragmentCount,
    FragmentStart,
    FragmentRange,
    FragmentBytes,
    LocatorList,
);

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn index_is_the_position_and_names_differ() {
        for (index, &counter) in Counter::ALL.iter().enumerate() {
            assert_eq!(counter as usize, index);
        }
        let names: BTreeSet<&str> = Counter::ALL.iter().map(|counter| counter.name()).collect();
        assert_eq!(names.len(), Counter::COUNT);
    }

    #[test]
    fn every_malformed_counter_has_its_reason() {
        let counters: BTreeSet<Counter> =
            Reason::ALL.iter().map(|reason| reason.counter()).collect();
        let malformed: BTreeSet<Counter> = Counter::ALL
            .iter()
            .copied()
            .filter(|counter| counter.name().starts_with("malformed_"))
            .collect();
        assert_eq!(counters, malformed);
    }
}
