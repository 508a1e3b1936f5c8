"""A publisher or subscriber of ShapeType on Eclipse Cyclone DDS 11: the command line and the events of peer.h."""

import argparse
import json
import os
import signal
import sys
import threading
import time
from dataclasses import dataclass

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import InstanceState, Listener
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.dynamic import get_types_for_typeid
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import appendable, final, key
from cyclonedds.idl.types import bounded_str, int32, sequence, uint8
from cyclonedds.pub import DataWriter, Publisher
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader, Subscriber
from cyclonedds.topic import Topic
from cyclonedds.util import duration

TAKE_AT_ONCE = 64
POLICIES = {2: "DURABILITY", 4: "DEADLINE", 6: "OWNERSHIP", 10: "PARTITION", 11: "RELIABILITY", 23: "DATA_REPRESENTATION"}

stopped = threading.Event()
printing = threading.Lock()


# Only final types are written as XCDR1.
@dataclass
@final
class Final(IdlStruct, typename="ShapeType"):
    color: bounded_str[128]
    key("color")
    x: int32
    y: int32
    shapesize: int32
    additional_payload_size: sequence[uint8]


@dataclass
@appendable
class Appendable(IdlStruct, typename="ShapeType"):
    color: bounded_str[128]
    key("color")
    x: int32
    y: int32
    shapesize: int32
    additional_payload_size: sequence[uint8]


def options():
    parser = argparse.ArgumentParser()
    role = parser.add_mutually_exclusive_group(required=True)
    role.add_argument("--pub", action="store_true")
    role.add_argument("--sub", action="store_true")
    # Asks whoever writes the topic for its type.
    role.add_argument("--type", action="store_true")
    parser.add_argument("--topic", default="Square")
    parser.add_argument("--domain", type=int, default=0)
    parser.add_argument("--count", type=int, default=0)
    parser.add_argument("--period-us", type=int, default=0)
    parser.add_argument("--reliable", action="store_true")
    parser.add_argument("--best-effort", action="store_true")
    parser.add_argument("--durability", choices=["volatile", "transient-local"], default="volatile")
    parser.add_argument("--history-keep-all", action="store_true")
    parser.add_argument("--keep-last", type=int)
    parser.add_argument("--size", type=int, default=0)
    parser.add_argument("--color", default="BLUE")
    parser.add_argument("--instances", type=int, default=1)
    parser.add_argument("--dispose", action="store_true")
    parser.add_argument("--unregister", action="store_true")
    parser.add_argument("--xcdr", type=int, choices=[1, 2], default=1)
    parser.add_argument("--partition")
    parser.add_argument("--wait-match", type=int, default=1)
    parser.add_argument("--settle", type=float, default=0.3)
    parser.add_argument("--linger", type=float, default=0)
    parser.add_argument("--timeout", type=float, default=30)
    parser.add_argument("--interface", required=True)
    parser.add_argument("--strength", type=int)
    parser.add_argument("--deadline-ms", type=int)
    return parser.parse_args()


def report(event, **fields):
    with printing:
        print(json.dumps({"event": event, **fields}), flush=True)


def configure_domain(asked):
    interfaces = f'<Interfaces><NetworkInterface name="{asked.interface}"/></Interfaces>'
    config = f"<General>{interfaces}</General>"
    more = os.environ.get("CYCLONEDDS_URI")
    return Domain(asked.domain, f"{config},{more}" if more else config)


def endpoint_qos(asked):
    history = Policy.History.KeepLast(asked.keep_last) if asked.keep_last else Policy.History.KeepAll
    reliable = Policy.Reliability.Reliable(duration(seconds=10))
    more = [] if asked.strength is None else [
        Policy.Ownership.Exclusive, Policy.OwnershipStrength(asked.strength)
    ]
    if asked.deadline_ms is not None:
        more.append(Policy.Deadline(duration(milliseconds=asked.deadline_ms)))
    late = asked.durability == "transient-local"
    return Qos(
        Policy.Reliability.BestEffort if asked.best_effort else reliable,
        Policy.Durability.TransientLocal if late else Policy.Durability.Volatile,
        history,
        # What late joiners get; by default it would be the last sample only.
        Policy.DurabilityService(0, history, -1, -1, -1),
        # The end of a publisher is then no dispose of its instances.
        Policy.WriterDataLifecycle(autodispose=False),
        Policy.DataRepresentation(
            use_cdrv0_representation=asked.xcdr == 1, use_xcdrv2_representation=asked.xcdr == 2
        ),
        *more,
    )


def group_qos(asked):
    return Qos(Policy.Partition([asked.partition])) if asked.partition else Qos()


def listener():
    def matched(_entity, status):
        report("matched", current=status.current_count)

    def incompatible(_entity, status):
        report("incompatible_qos", policy=POLICIES.get(status.last_policy_id, "UNKNOWN"))

    return Listener(
        on_publication_matched=matched,
        on_subscription_matched=matched,
        on_offered_incompatible_qos=incompatible,
        on_requested_incompatible_qos=incompatible,
    )


def colors(asked):
    return [asked.color + (str(number) if number else "") for number in range(asked.instances)]


def publish(asked, writer, shape_type, give_up):
    def keeps_going():
        return not stopped.is_set() and time.monotonic() < give_up

    while keeps_going() and len(writer.get_matched_subscriptions()) < asked.wait_match:
        time.sleep(0.001)
    stopped.wait(asked.settle)
    payload = [0] * asked.size
    names = colors(asked)
    sent = 0
    while keeps_going() and (asked.count == 0 or sent < asked.count):
        writer.write(shape_type(names[sent % len(names)], sent, sent, 30, payload))
        sent += 1
        if asked.period_us:
            time.sleep(asked.period_us / 1e6)
    for name in names:
        if asked.dispose:
            writer.dispose(shape_type(name, 0, 0, 0, []))
        if asked.unregister:
            writer.unregister_instance(shape_type(name, 0, 0, 0, []))
    if not asked.best_effort and keeps_going():
        writer.wait_for_acks(duration(seconds=give_up - time.monotonic()))
    stopped.wait(asked.linger)
    report("done", sent=sent, received=0)
    return sent >= asked.count


def tell_type(asked, participant, give_up):
    endpoints = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
    while not stopped.is_set() and time.monotonic() < give_up:
        for endpoint in endpoints.take(TAKE_AT_ONCE):
            if endpoint.topic_name == asked.topic and endpoint.type_id is not None:
                found, _ = get_types_for_typeid(participant, endpoint.type_id, duration(seconds=10))
                report("type", name=found.__idl_typename__, members=list(found.__annotations__))
                return True
        time.sleep(0.01)
    return False


def take(reader):
    received = 0
    for sample in reader.take(TAKE_AT_ONCE):
        info = sample.sample_info
        if info.valid_data:
            report("sample", color=sample.color, x=sample.x, size=len(sample.additional_payload_size))
            received += 1
        # One take of an instance's last data may carry the end of the instance with it.
        color = sample.color if info.valid_data else sample.key_sample.color
        if info.sample_rank == 0 and info.instance_state == InstanceState.NotAliveDisposed:
            report("disposed", color=color)
        elif info.sample_rank == 0 and info.instance_state == InstanceState.NotAliveNoWriters:
            report("unregistered", color=color)
    return received


def subscribe(asked, reader, give_up):
    received = 0
    linger_until = None
    while not stopped.is_set() and time.monotonic() < give_up:
        if asked.count and received >= asked.count:
            linger_until = linger_until or time.monotonic() + asked.linger
            if time.monotonic() >= linger_until:
                break
        taken = take(reader)
        received += taken
        if not taken:
            time.sleep(0.002)
    report("done", sent=0, received=received)
    return received >= asked.count


def main():
    asked = options()
    give_up = time.monotonic() + asked.timeout
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    _domain = configure_domain(asked)
    participant = DomainParticipant(asked.domain)
    if asked.type:
        return tell_type(asked, participant, give_up)
    shape_type = Appendable if asked.xcdr == 2 else Final
    topic = Topic(participant, asked.topic, shape_type)
    qos, group = endpoint_qos(asked), group_qos(asked)
    if asked.pub:
        publisher = Publisher(participant, group)
        writer = DataWriter(publisher, topic, qos, listener())
        return publish(asked, writer, shape_type, give_up)
    subscriber = Subscriber(participant, group)
    return subscribe(asked, DataReader(subscriber, topic, qos, listener()), give_up)


if __name__ == "__main__":
    sys.exit(0 if main() else 1)
