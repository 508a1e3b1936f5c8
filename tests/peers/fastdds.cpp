// A publisher or subscriber of ShapeType on eProsima Fast DDS 2.9.
#include "peer.h"
#include "shape_type.hpp"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/ContentFilteredTopic.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastdds/rtps/transport/UDPv6TransportDescriptor.h>
#include <fastrtps/types/DynamicPubSubType.h>
#include <fastrtps/types/DynamicTypeBuilder.h>
#include <fastrtps/types/DynamicTypeBuilderFactory.h>
#include <fastrtps/types/DynamicTypeBuilderPtr.h>
#include <fastrtps/utils/IPLocator.h>

using namespace eprosima::fastdds::dds;
using eprosima::fastdds::rtps::UDPTransportDescriptor;
using eprosima::fastdds::rtps::UDPv4TransportDescriptor;
using eprosima::fastdds::rtps::UDPv6TransportDescriptor;
using eprosima::fastrtps::Duration_t;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;
using eprosima::fastrtps::types::DynamicPubSubType;
using eprosima::fastrtps::types::DynamicType_ptr;
using eprosima::fastrtps::types::DynamicTypeBuilder_ptr;
using eprosima::fastrtps::types::DynamicTypeBuilderFactory;
using eprosima::fastrtps::types::ReturnCode_t;

namespace {

// Above this a sample does not fit one UDP datagram and Fast DDS wants its asynchronous writer.
constexpr uint32_t SYNCHRONOUS_MAX = 60000;

peer_options options;
double give_up_at;

template <typename T> T* checked(const char* call, T* made)
{
    if (made == nullptr) {
        peer_print_error(call);
        std::exit(1);
    }
    return made;
}

void checked(const char* call, ReturnCode_t code)
{
    if (code != ReturnCode_t::RETCODE_OK) {
        peer_print_error((std::string(call) + ": return code " + std::to_string(code())).c_str());
        std::exit(1);
    }
}

bool keep_going()
{
    return !peer_stopped() && peer_now() < give_up_at;
}

void pause_for(double seconds)
{
    double until = peer_now() + seconds;
    while (!peer_stopped() && peer_now() < until)
        peer_sleep_us(10000);
}

void print_policy(uint32_t id)
{
    const char* name = peer_policy_name(id);
    if (id == DATAREPRESENTATION_QOS_POLICY_ID)
        name = "DATA_REPRESENTATION";
    else if (id == TYPECONSISTENCYENFORCEMENT_QOS_POLICY_ID)
        name = "TYPE_CONSISTENCY_ENFORCEMENT";
    peer_print_policy(name != nullptr ? name : "UNKNOWN");
}

bool is_ipv6(const char* address)
{
    return address != nullptr && std::strchr(address, ':') != nullptr;
}

DomainParticipantQos participant_qos()
{
    DomainParticipantQos qos;
    // UDP only: by default two processes of one host would talk through shared memory.
    std::shared_ptr<UDPTransportDescriptor> udp;
    if (is_ipv6(options.interface))
        udp = std::make_shared<UDPv6TransportDescriptor>();
    else
        udp = std::make_shared<UDPv4TransportDescriptor>();
    if (options.interface != nullptr)
        udp->interfaceWhiteList.emplace_back(options.interface);
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(udp);
    auto& builtin = qos.wire_protocol().builtin;
    Locator_t locator;
    if (is_ipv6(options.interface))
        locator.kind = LOCATOR_KIND_UDPv6;
    if (!options.multicast) {
        // A unicast locator of our own keeps the library from adding the multicast group.
        builtin.metatrafficUnicastLocatorList.push_back(locator);
    }
    if (options.peer != nullptr) {
        if (is_ipv6(options.peer))
            IPLocator::setIPv6(locator, std::string(options.peer));
        else
            IPLocator::setIPv4(locator, std::string(options.peer));
        builtin.initialPeersList.push_back(locator);
    }
    return qos;
}

// The policies that writers and readers have in common.
template <typename Qos> Qos endpoint_qos(Qos qos)
{
    qos.reliability().kind =
        options.reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    qos.reliability().max_blocking_time = Duration_t(10, 0);
    qos.durability().kind =
        options.transient_local ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    if (options.history_depth == 0) {
        qos.history().kind = KEEP_ALL_HISTORY_QOS;
    } else {
        qos.history().kind = KEEP_LAST_HISTORY_QOS;
        qos.history().depth = options.history_depth;
    }
    // 0 is unlimited here; the defaults are 5000 samples and 10 instances.
    qos.resource_limits().max_samples = 0;
    qos.resource_limits().max_instances = 0;
    qos.resource_limits().max_samples_per_instance = 0;
    if (options.deadline_ms != 0)
        qos.deadline().period = Duration_t(static_cast<long double>(options.deadline_ms) / 1000);
    if (options.liveliness_ms != 0) {
        const long double lease = static_cast<long double>(options.liveliness_ms) / 1000;
        qos.liveliness().lease_duration = Duration_t(lease);
        qos.liveliness().announcement_period = Duration_t(lease / 2);
    }
    if (options.strength >= 0)
        qos.ownership().kind = EXCLUSIVE_OWNERSHIP_QOS;
    qos.endpoint().history_memory_policy =
        eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    return qos;
}

class WriterEvents : public DataWriterListener {
public:
    void on_publication_matched(DataWriter*, const PublicationMatchedStatus& status) override
    {
        matched = status.current_count;
        peer_print_number("matched", "current", status.current_count);
    }

    void on_offered_incompatible_qos(DataWriter*,
                                     const OfferedIncompatibleQosStatus& status) override
    {
        print_policy(status.last_policy_id);
    }

    void on_offered_deadline_missed(DataWriter*, const OfferedDeadlineMissedStatus& status) override
    {
        peer_print_number("deadline_missed", "total", status.total_count);
    }

    std::atomic<int32_t> matched{0};
};

class ReaderEvents : public DataReaderListener {
public:
    void on_subscription_matched(DataReader*, const SubscriptionMatchedStatus& status) override
    {
        peer_print_number("matched", "current", status.current_count);
    }

    void on_requested_incompatible_qos(DataReader*,
                                       const RequestedIncompatibleQosStatus& status) override
    {
        print_policy(status.last_policy_id);
    }

    void on_requested_deadline_missed(DataReader*,
                                      const RequestedDeadlineMissedStatus& status) override
    {
        peer_print_number("deadline_missed", "total", status.total_count);
    }

    void on_liveliness_changed(DataReader*, const LivelinessChangedStatus& status) override
    {
        peer_print_number("liveliness", "alive", status.alive_count);
    }

    void on_data_available(DataReader* reader) override
    {
        ShapeType shape;
        SampleInfo info;
        while (reader->take_next_sample(&shape, &info) == ReturnCode_t::RETCODE_OK) {
            if (info.valid_data) {
                colors_[info.instance_handle] = shape.color;
                auto size = static_cast<uint32_t>(shape.additional_payload_size.size());
                peer_print_sample(shape.color.c_str(), shape.x, size);
                received++;
            } else {
                print_end(info);
            }
        }
    }

    std::atomic<uint64_t> received{0};

private:
    // The sample that ends an instance need not carry the key.
    void print_end(const SampleInfo& info)
    {
        const char* color = colors_[info.instance_handle].c_str();
        if (info.instance_state == NOT_ALIVE_DISPOSED_INSTANCE_STATE)
            peer_print_color("disposed", color);
        else if (info.instance_state == NOT_ALIVE_NO_WRITERS_INSTANCE_STATE)
            peer_print_color("unregistered", color);
    }

    std::map<InstanceHandle_t, std::string> colors_;
};

void end_instances(DataWriter* writer, ShapeType& shape)
{
    for (uint32_t i = 0; i < options.instances; i++) {
        char color[PEER_COLOR_MAX + 1];
        peer_instance_color(&options, i, color);
        shape.color = color;
        // Fast DDS takes either for the end of the writer's registration.
        if (options.dispose)
            checked("dispose", writer->dispose(&shape, InstanceHandle_t()));
        else if (options.unregister)
            checked("unregister", writer->unregister_instance(&shape, InstanceHandle_t()));
    }
}

bool publish(DataWriter* writer, const WriterEvents& events)
{
    while (keep_going() && events.matched < options.wait_match)
        peer_sleep_us(1000);
    pause_for(options.settle_s);
    ShapeType shape;
    shape.shapesize = 30;
    shape.additional_payload_size.resize(options.size);
    uint64_t sent = 0;
    while (keep_going() && (options.count == 0 || sent < options.count)) {
        char color[PEER_COLOR_MAX + 1];
        peer_instance_color(&options, static_cast<uint32_t>(sent % options.instances), color);
        shape.color = color;
        shape.x = static_cast<int32_t>(sent);
        shape.y = static_cast<int32_t>(sent);
        if (!writer->write(&shape)) {
            peer_print_error("write");
            std::exit(1);
        }
        sent++;
        if (options.period_us != 0)
            peer_sleep_us(options.period_us);
    }
    end_instances(writer, shape);
    if (options.reliable && keep_going()) {
        auto left = static_cast<long double>(give_up_at - peer_now());
        checked("wait_for_acknowledgments", writer->wait_for_acknowledgments(Duration_t(left)));
    }
    pause_for(options.linger_s);
    peer_print_done(sent, 0);
    return sent >= options.count;
}

bool subscribe(const ReaderEvents& events)
{
    while (keep_going() && (options.count == 0 || events.received < options.count))
        peer_sleep_us(5000);
    if (keep_going())
        pause_for(options.linger_s);
    peer_print_done(0, events.received);
    return events.received >= options.count;
}

// Filters look into samples by the description that is known under the type's name. Registering a
// dynamic type under any name makes its description known under its own.
void describe_type(DomainParticipant* participant)
{
    auto factory = DynamicTypeBuilderFactory::get_instance();
    DynamicTypeBuilder_ptr octets(factory->create_sequence_builder(factory->create_byte_type()));
    DynamicTypeBuilder_ptr shape(factory->create_struct_builder());
    shape->set_name("ShapeType");
    shape->add_member(0, "color", factory->create_string_type(PEER_COLOR_MAX));
    shape->add_member(1, "x", factory->create_int32_type());
    shape->add_member(2, "y", factory->create_int32_type());
    shape->add_member(3, "shapesize", factory->create_int32_type());
    shape->add_member(4, "additional_payload_size", octets->build());
    TypeSupport description(new DynamicPubSubType(shape->build()));
    checked("register_type", description.register_type(participant, "description"));
}

// What is read: the topic, or what a filter leaves of it.
TopicDescription* description(DomainParticipant* participant, Topic* topic)
{
    if (options.filter == nullptr)
        return topic;
    std::vector<std::string> parameters;
    if (options.parameter != nullptr)
        parameters.emplace_back(options.parameter);
    return checked("create_contentfilteredtopic",
                   participant->create_contentfilteredtopic("Filtered", topic, options.filter,
                                                            parameters));
}

bool run_publisher(DomainParticipant* participant, Topic* topic)
{
    PublisherQos group;
    if (options.partition != nullptr)
        group.partition().push_back(options.partition);
    auto publisher = checked("create_publisher", participant->create_publisher(group));
    DataWriterQos qos = endpoint_qos(DataWriterQos());
    // By default 3 s, which would be the time until the last sample is acknowledged.
    qos.reliable_writer_qos().times.heartbeatPeriod = Duration_t(0.1L);
    qos.writer_data_lifecycle().autodispose_unregistered_instances = false;
    qos.ownership_strength().value = std::max(options.strength, 0);
    if (options.size > SYNCHRONOUS_MAX)
        qos.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;
    WriterEvents events;
    auto writer =
        checked("create_datawriter", publisher->create_datawriter(topic, qos, &events));
    bool complete = publish(writer, events);
    // The listener ends before the participant does.
    writer->set_listener(nullptr);
    return complete;
}

bool run_subscriber(DomainParticipant* participant, Topic* topic)
{
    SubscriberQos group;
    if (options.partition != nullptr)
        group.partition().push_back(options.partition);
    auto subscriber = checked("create_subscriber", participant->create_subscriber(group));
    DataReaderQos qos = endpoint_qos(DataReaderQos());
    ReaderEvents events;
    auto reader =
        checked("create_datareader", subscriber->create_datareader(
                                         description(participant, topic), qos, &events));
    bool complete = subscribe(events);
    reader->set_listener(nullptr);
    return complete;
}

} // namespace

int main(int argc, char** argv)
{
    options = peer_options_parse(argc, argv);
    if (options.xcdr != 1) {
        // It does not send the policy DATA_REPRESENTATION either, which means XCDR1.
        peer_print_error("Fast DDS 2.9 writes and reads XCDR1 only");
        return 2;
    }
    give_up_at = peer_now() + options.timeout_s;
    peer_catch_signals();
    auto factory = DomainParticipantFactory::get_instance();
    auto participant = checked("create_participant",
                               factory->create_participant(options.domain, participant_qos()));
    TypeSupport type(new ShapeTypeSupport(options.size));
    checked("register_type", type.register_type(participant));
    if (options.filters || options.filter != nullptr)
        describe_type(participant);
    auto topic = checked("create_topic", participant->create_topic(options.topic, "ShapeType",
                                                                   TOPIC_QOS_DEFAULT));
    bool complete = options.publisher ? run_publisher(participant, topic)
                                      : run_subscriber(participant, topic);
    participant->delete_contained_entities();
    factory->delete_participant(participant);
    return complete ? 0 : 1;
}
