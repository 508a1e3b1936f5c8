/* A publisher or subscriber of ShapeType on Eclipse Cyclone DDS 0.10. */
#include "peer.h"

#include <dds/dds.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ShapeType.h"

/* The build compiles the IDL twice and renames the descriptors (see ShapeType.idl). */
extern const dds_topic_descriptor_t ShapeType_final_desc;
extern const dds_topic_descriptor_t ShapeType_appendable_desc;

#define TAKE_AT_ONCE 64

static struct peer_options options;
static double give_up_at;

/* Ends the program with the reason when a call of the library failed; else returns its result. */
static dds_entity_t checked(const char *call, dds_return_t result)
{
    if (result < 0) {
        char message[256];
        snprintf(message, sizeof message, "%s: %s", call, dds_strretcode(-result));
        peer_print_error(message);
        exit(1);
    }
    return result;
}

static void append(char *text, size_t room, const char *format, ...)
{
    size_t used = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    int written = vsnprintf(text + used, room - used, format, arguments);
    va_end(arguments);
    if (written < 0 || (size_t)written >= room - used) {
        peer_print_error("configuration too long");
        exit(1);
    }
}

/* The domain's configuration: ours, then what CYCLONEDDS_URI adds (tracing, say). */
static void configure_domain(void)
{
    char config[2048] = "<General>";
    if (options.interface != NULL)
        append(config, sizeof config,
               "<Interfaces><NetworkInterface name=\"%s\"/></Interfaces>", options.interface);
    append(config, sizeof config, "<AllowMulticast>%s</AllowMulticast></General>",
           options.multicast ? "true" : "false");
    append(config, sizeof config, "<Discovery>");
    if (options.peer != NULL)
        append(config, sizeof config, "<Peers><Peer Address=\"%s\"/></Peers>", options.peer);
    /* Without multicast a remote finds us only on the ports that the standard computes. */
    if (!options.multicast)
        append(config, sizeof config, "<ParticipantIndex>auto</ParticipantIndex>");
    append(config, sizeof config, "</Discovery>");
    const char *uri = getenv("CYCLONEDDS_URI");
    if (uri != NULL && *uri != '\0')
        append(config, sizeof config, ",%s", uri);
    checked("dds_create_domain", dds_create_domain(options.domain, config));
}

static dds_qos_t *endpoint_qos(void)
{
    dds_qos_t *qos = dds_create_qos();
    dds_qset_reliability(
        qos, options.reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
        DDS_SECS(10));
    dds_qset_durability(
        qos, options.transient_local ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
    dds_history_kind_t kind =
        options.history_depth == 0 ? DDS_HISTORY_KEEP_ALL : DDS_HISTORY_KEEP_LAST;
    dds_qset_history(qos, kind, options.history_depth);
    /* What late joiners get; by default it would be the last sample only. */
    dds_qset_durability_service(qos, 0, kind, options.history_depth == 0 ? 1 : options.history_depth,
                                DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
    /* The end of a publisher is then no dispose of its instances. */
    dds_qset_writer_data_lifecycle(qos, false);
    if (options.deadline_ms != 0)
        dds_qset_deadline(qos, DDS_MSECS((dds_duration_t)options.deadline_ms));
    if (options.liveliness_ms != 0)
        dds_qset_liveliness(qos, DDS_LIVELINESS_AUTOMATIC,
                            DDS_MSECS((dds_duration_t)options.liveliness_ms));
    if (options.strength >= 0) {
        dds_qset_ownership(qos, DDS_OWNERSHIP_EXCLUSIVE);
        dds_qset_ownership_strength(qos, options.strength);
    }
    dds_data_representation_id_t representation =
        options.xcdr == 2 ? DDS_DATA_REPRESENTATION_XCDR2 : DDS_DATA_REPRESENTATION_XCDR1;
    dds_qset_data_representation(qos, 1, &representation);
    return qos;
}

/* A publisher or subscriber exists only to carry the partition. */
static dds_qos_t *group_qos(void)
{
    dds_qos_t *qos = dds_create_qos();
    if (options.partition != NULL)
        dds_qset_partition1(qos, options.partition);
    return qos;
}

static void print_policy(uint32_t id)
{
    const char *name = peer_policy_name(id);
    if (id == DDS_DATA_REPRESENTATION_QOS_POLICY_ID)
        name = "DATA_REPRESENTATION";
    else if (id == DDS_TYPE_CONSISTENCY_ENFORCEMENT_QOS_POLICY_ID)
        name = "TYPE_CONSISTENCY_ENFORCEMENT";
    peer_print_policy(name != NULL ? name : "UNKNOWN");
}

static void on_publication_matched(dds_entity_t writer,
                                   const dds_publication_matched_status_t status, void *argument)
{
    (void)writer, (void)argument;
    peer_print_number("matched", "current", status.current_count);
}

static void on_offered_incompatible(dds_entity_t writer,
                                    const dds_offered_incompatible_qos_status_t status,
                                    void *argument)
{
    (void)writer, (void)argument;
    print_policy(status.last_policy_id);
}

static void on_offered_deadline_missed(dds_entity_t writer,
                                       const dds_offered_deadline_missed_status_t status,
                                       void *argument)
{
    (void)writer, (void)argument;
    peer_print_number("deadline_missed", "total", status.total_count);
}

static void on_subscription_matched(dds_entity_t reader,
                                    const dds_subscription_matched_status_t status, void *argument)
{
    (void)reader, (void)argument;
    peer_print_number("matched", "current", status.current_count);
}

static void on_requested_incompatible(dds_entity_t reader,
                                      const dds_requested_incompatible_qos_status_t status,
                                      void *argument)
{
    (void)reader, (void)argument;
    print_policy(status.last_policy_id);
}

static void on_requested_deadline_missed(dds_entity_t reader,
                                         const dds_requested_deadline_missed_status_t status,
                                         void *argument)
{
    (void)reader, (void)argument;
    peer_print_number("deadline_missed", "total", status.total_count);
}

static void on_liveliness_changed(dds_entity_t reader,
                                  const dds_liveliness_changed_status_t status, void *argument)
{
    (void)reader, (void)argument;
    peer_print_number("liveliness", "alive", status.alive_count);
}

static dds_listener_t *endpoint_listener(void)
{
    dds_listener_t *listener = dds_create_listener(NULL);
    if (options.publisher) {
        dds_lset_publication_matched(listener, on_publication_matched);
        dds_lset_offered_incompatible_qos(listener, on_offered_incompatible);
        dds_lset_offered_deadline_missed(listener, on_offered_deadline_missed);
    } else {
        dds_lset_subscription_matched(listener, on_subscription_matched);
        dds_lset_requested_incompatible_qos(listener, on_requested_incompatible);
        dds_lset_requested_deadline_missed(listener, on_requested_deadline_missed);
        dds_lset_liveliness_changed(listener, on_liveliness_changed);
    }
    return listener;
}

static bool keep_going(void)
{
    return !peer_stopped() && peer_now() < give_up_at;
}

static void pause_for(double seconds)
{
    double until = peer_now() + seconds;
    while (!peer_stopped() && peer_now() < until)
        peer_sleep_us(10000);
}

/* The library counts matches that it has already told the listener about, too. */
static int32_t matched_readers(dds_entity_t writer)
{
    dds_instance_handle_t handles[64];
    return checked("dds_get_matched_subscriptions",
                   dds_get_matched_subscriptions(writer, handles, 64));
}

static void end_instances(dds_entity_t writer, ShapeType *shape)
{
    for (uint32_t i = 0; i < options.instances; i++) {
        peer_instance_color(&options, i, shape->color);
        if (options.dispose)
            checked("dds_dispose", dds_dispose(writer, shape));
        if (options.unregister)
            checked("dds_unregister_instance", dds_unregister_instance(writer, shape));
    }
}

static bool publish(dds_entity_t writer)
{
    while (keep_going() && matched_readers(writer) < options.wait_match)
        peer_sleep_us(1000);
    pause_for(options.settle_s);
    ShapeType shape = {.shapesize = 30};
    shape.additional_payload_size._length = options.size;
    shape.additional_payload_size._maximum = options.size;
    shape.additional_payload_size._buffer = calloc(options.size + 1, 1);
    uint64_t sent = 0;
    while (keep_going() && (options.count == 0 || sent < options.count)) {
        peer_instance_color(&options, (uint32_t)(sent % options.instances), shape.color);
        shape.x = (int32_t)sent;
        shape.y = (int32_t)sent;
        checked("dds_write", dds_write(writer, &shape));
        sent++;
        if (options.period_us != 0)
            peer_sleep_us(options.period_us);
    }
    end_instances(writer, &shape);
    if (options.reliable && keep_going())
        checked("dds_wait_for_acks",
                dds_wait_for_acks(writer, (dds_duration_t)((give_up_at - peer_now()) * 1e9)));
    pause_for(options.linger_s);
    peer_print_done(sent, 0);
    free(shape.additional_payload_size._buffer);
    return sent >= options.count;
}

static uint64_t take(dds_entity_t reader)
{
    void *samples[TAKE_AT_ONCE] = {NULL};
    dds_sample_info_t infos[TAKE_AT_ONCE];
    dds_return_t taken = checked(
        "dds_take", dds_take(reader, samples, infos, TAKE_AT_ONCE, TAKE_AT_ONCE));
    uint64_t received = 0;
    for (dds_return_t i = 0; i < taken; i++) {
        const ShapeType *shape = samples[i];
        if (infos[i].valid_data) {
            peer_print_sample(shape->color, shape->x, shape->additional_payload_size._length);
            received++;
        }
        /* One take of an instance's last data may carry the end of the instance with it. */
        bool last_of_instance = infos[i].sample_rank == 0;
        if (last_of_instance && infos[i].instance_state == DDS_NOT_ALIVE_DISPOSED_INSTANCE_STATE)
            peer_print_color("disposed", shape->color);
        else if (last_of_instance &&
                 infos[i].instance_state == DDS_NOT_ALIVE_NO_WRITERS_INSTANCE_STATE)
            peer_print_color("unregistered", shape->color);
    }
    if (taken > 0)
        checked("dds_return_loan", dds_return_loan(reader, samples, taken));
    return received;
}

static bool subscribe(dds_entity_t participant, dds_entity_t reader)
{
    dds_entity_t waitset = checked("dds_create_waitset", dds_create_waitset(participant));
    dds_entity_t condition =
        checked("dds_create_readcondition", dds_create_readcondition(reader, DDS_ANY_STATE));
    checked("dds_waitset_attach", dds_waitset_attach(waitset, condition, 0));
    uint64_t received = 0;
    double linger_until = 0;
    while (keep_going()) {
        if (options.count != 0 && received >= options.count) {
            if (linger_until == 0)
                linger_until = peer_now() + options.linger_s;
            if (peer_now() >= linger_until)
                break;
        }
        checked("dds_waitset_wait", dds_waitset_wait(waitset, NULL, 0, DDS_MSECS(20)));
        received += take(reader);
    }
    peer_print_done(0, received);
    return received >= options.count;
}

int main(int argc, char **argv)
{
    options = peer_options_parse(argc, argv);
    give_up_at = peer_now() + options.timeout_s;
    peer_catch_signals();
    configure_domain();
    dds_entity_t participant = checked(
        "dds_create_participant", dds_create_participant(options.domain, NULL, NULL));
    const dds_topic_descriptor_t *type =
        options.xcdr == 2 ? &ShapeType_appendable_desc : &ShapeType_final_desc;
    dds_qos_t *qos = endpoint_qos();
    dds_qos_t *group = group_qos();
    dds_listener_t *listener = endpoint_listener();
    dds_entity_t topic = checked(
        "dds_create_topic", dds_create_topic(participant, type, options.topic, NULL, NULL));
    bool complete;
    if (options.publisher) {
        dds_entity_t publisher =
            checked("dds_create_publisher", dds_create_publisher(participant, group, NULL));
        complete = publish(
            checked("dds_create_writer", dds_create_writer(publisher, topic, qos, listener)));
    } else {
        dds_entity_t subscriber =
            checked("dds_create_subscriber", dds_create_subscriber(participant, group, NULL));
        complete = subscribe(
            participant,
            checked("dds_create_reader", dds_create_reader(subscriber, topic, qos, listener)));
    }
    dds_delete_listener(listener);
    dds_delete_qos(group);
    dds_delete_qos(qos);
    dds_delete(DDS_CYCLONEDDS_HANDLE);
    return complete ? 0 : 1;
}
