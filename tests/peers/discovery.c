/* One participant with many endpoints on Eclipse Cyclone DDS 0.10, which reports when all of them are matched.
 *
 * An "app" writes the topics Out0, Out1... and reads In0, In1...; a "remote" does it the other way round, so that
 * apps match remotes only. Policies are the standard's defaults (reliable writers, best-effort readers), so that matches
 * cause no traffic of their own. */
#include "peer.h"

#include <dds/dds.h>
#include <getopt.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ShapeType.h"

/* The build compiles the IDL twice and renames the descriptors (see ShapeType.idl). */
extern const dds_topic_descriptor_t ShapeType_final_desc;

#define ENDPOINTS_MAX 64

static struct {
    const char *interface;
    uint32_t domain;
    int endpoints; /* writers, and as many readers */
    int expect;    /* matches of each endpoint that are waited for */
    bool remote;
    int participant_index; /* which its ports follow from; -1: any ports */
    double timeout_s;
} options = {.endpoints = 5, .expect = 1, .participant_index = -1, .timeout_s = 600};

/* Matches of each writer, then of each reader; the listeners run on threads of the library. */
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static uint32_t matched[2 * ENDPOINTS_MAX];
static bool reported = false;

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

static void usage(const char *program)
{
    fprintf(stderr,
            "usage: %s [--remote] [--interface I] [--domain N] [--endpoints N] [--expect N]\n"
            "       [--participant-index N] [--timeout S]\n",
            program);
    exit(2);
}

static void parse(int argc, char **argv)
{
    static const struct option long_options[] = {
        {"remote", no_argument, NULL, 'r'},
        {"interface", required_argument, NULL, 'I'},
        {"domain", required_argument, NULL, 'd'},
        {"endpoints", required_argument, NULL, 'n'},
        {"expect", required_argument, NULL, 'x'},
        {"participant-index", required_argument, NULL, 'p'},
        {"timeout", required_argument, NULL, 'T'},
        {NULL, 0, NULL, 0},
    };
    int option;
    while ((option = getopt_long(argc, argv, "", long_options, NULL)) != -1) {
        switch (option) {
        case 'r': options.remote = true; break;
        case 'I': options.interface = optarg; break;
        case 'd': options.domain = (uint32_t)atoi(optarg); break;
        case 'n': options.endpoints = atoi(optarg); break;
        case 'x': options.expect = atoi(optarg); break;
        case 'p': options.participant_index = atoi(optarg); break;
        case 'T': options.timeout_s = atof(optarg); break;
        default: usage(argv[0]);
        }
    }
    if (optind != argc || options.endpoints < 1 || options.endpoints > ENDPOINTS_MAX)
        usage(argv[0]);
}

/* The domain's configuration: ours, then what CYCLONEDDS_URI adds (tracing, say). */
static void configure_domain(void)
{
    char interfaces[256] = "", index[128] = "", config[2048];
    if (options.interface != NULL)
        snprintf(interfaces, sizeof interfaces,
                 "<General><Interfaces><NetworkInterface name=\"%s\"/></Interfaces></General>",
                 options.interface);
    if (options.participant_index >= 0)
        snprintf(index, sizeof index,
                 "<Discovery><ParticipantIndex>%d</ParticipantIndex></Discovery>",
                 options.participant_index);
    const char *uri = getenv("CYCLONEDDS_URI");
    bool has_uri = uri != NULL && *uri != '\0';
    snprintf(config, sizeof config, "%s%s%s%s", interfaces, index, has_uri ? "," : "",
             has_uri ? uri : "");
    checked("dds_create_domain", dds_create_domain(options.domain, config));
}

static void note_matches(size_t endpoint, uint32_t current)
{
    pthread_mutex_lock(&lock);
    matched[endpoint] = current;
    bool complete = true;
    for (int i = 0; i < options.endpoints; i++)
        complete = complete && matched[i] >= (uint32_t)options.expect &&
                   matched[ENDPOINTS_MAX + i] >= (uint32_t)options.expect;
    bool is_news = complete && !reported;
    reported = reported || complete;
    pthread_mutex_unlock(&lock);
    if (is_news)
        peer_print_number("matched", "current", options.expect);
}

static void on_publication_matched(dds_entity_t writer,
                                   const dds_publication_matched_status_t status, void *argument)
{
    (void)writer;
    note_matches((size_t)argument, status.current_count);
}

static void on_subscription_matched(dds_entity_t reader,
                                    const dds_subscription_matched_status_t status, void *argument)
{
    (void)reader;
    note_matches((size_t)argument, status.current_count);
}

static dds_entity_t topic(dds_entity_t participant, const char *direction, int number)
{
    char name[32];
    snprintf(name, sizeof name, "%s%d", direction, number);
    return checked("dds_create_topic",
                   dds_create_topic(participant, &ShapeType_final_desc, name, NULL, NULL));
}

static void create_endpoints(dds_entity_t participant)
{
    const char *written = options.remote ? "In" : "Out", *read = options.remote ? "Out" : "In";
    for (int i = 0; i < options.endpoints; i++) {
        dds_listener_t *of_writer = dds_create_listener((void *)(size_t)i);
        dds_lset_publication_matched(of_writer, on_publication_matched);
        checked("dds_create_writer",
                dds_create_writer(participant, topic(participant, written, i), NULL, of_writer));
        dds_listener_t *of_reader = dds_create_listener((void *)(size_t)(ENDPOINTS_MAX + i));
        dds_lset_subscription_matched(of_reader, on_subscription_matched);
        checked("dds_create_reader",
                dds_create_reader(participant, topic(participant, read, i), NULL, of_reader));
        dds_delete_listener(of_writer);
        dds_delete_listener(of_reader);
    }
}

int main(int argc, char **argv)
{
    parse(argc, argv);
    double give_up_at = peer_now() + options.timeout_s;
    peer_catch_signals();
    configure_domain();
    /* The time that the process takes to start is not the network's. */
    peer_print_number("begin", "domain", options.domain);
    create_endpoints(checked("dds_create_participant",
                             dds_create_participant(options.domain, NULL, NULL)));
    peer_print_number("ready", "endpoints", 2 * options.endpoints);
    while (!peer_stopped() && peer_now() < give_up_at)
        peer_sleep_us(200000);
    dds_delete(DDS_CYCLONEDDS_HANDLE);
    return 0;
}
