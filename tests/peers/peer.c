#include "peer.h"

#include <errno.h>
#include <getopt.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static volatile sig_atomic_t stopped = 0;

static void usage(const char *program)
{
    fprintf(stderr,
            "usage: %s --pub|--sub [options]\n"
            "  --topic T            topic name (Square)\n"
            "  --domain N           domain id (0)\n"
            "  --count N            samples to write or to receive, 0: until stopped (0)\n"
            "  --period-us U        pause between two samples (0)\n"
            "  --reliable | --best-effort                    (--reliable)\n"
            "  --durability volatile|transient-local         (volatile)\n"
            "  --history-keep-all | --keep-last N            (--history-keep-all)\n"
            "  --size BYTES         additional payload (0)\n"
            "  --color C            key of the instance (BLUE)\n"
            "  --instances N        instances C, C1, C2... in turn (1)\n"
            "  --dispose            publisher disposes its instances at the end\n"
            "  --unregister         publisher unregisters its instances at the end\n"
            "  --xcdr 1|2           data representation (1)\n"
            "  --partition P        partition (the default one)\n"
            "  --wait-match N       publisher waits for N matched readers (1)\n"
            "  --settle S           pause between matching and the first sample: the other side\n"
            "                       may match later, and volatile samples from before are lost (0.3)\n"
            "  --linger S           stays S seconds after the count is reached (0)\n"
            "  --timeout S          gives up after S seconds (30)\n"
            "  --multicast on|off   discovery by multicast (on)\n"
            "  --peer ADDR          address to announce to\n"
            "  --interface I        network interface (Cyclone: name, Fast DDS: address)\n"
            "  --deadline-ms D      deadline QoS (none)\n"
            "  --liveliness-ms L    lease of AUTOMATIC liveliness (none)\n"
            "  --strength N         EXCLUSIVE ownership; of a publisher with that strength (SHARED)\n"
            "  --filter E           read what passes this expression (Fast DDS only)\n"
            "  --filter-parameter P what stands for %%0 in it\n"
            "  --filters            write only what readers want (Fast DDS only)\n",
            program);
    exit(2);
}

static uint64_t number(const char *program, const char *text)
{
    char *end = NULL;
    errno = 0;
    uint64_t value = strtoull(text, &end, 10);
    if (errno != 0 || end == text || *end != '\0' || *text == '-') {
        fprintf(stderr, "%s: not a number: %s\n", program, text);
        usage(program);
    }
    return value;
}

static double seconds(const char *program, const char *text)
{
    char *end = NULL;
    double value = strtod(text, &end);
    if (end == text || *end != '\0' || value < 0) {
        fprintf(stderr, "%s: not a time in seconds: %s\n", program, text);
        usage(program);
    }
    return value;
}

static bool choice(const char *program, const char *text, const char *yes, const char *no)
{
    if (strcmp(text, yes) == 0)
        return true;
    if (strcmp(text, no) == 0)
        return false;
    fprintf(stderr, "%s: %s is neither %s nor %s\n", program, text, yes, no);
    usage(program);
    return false;
}

static const struct option long_options[] = {
    {"pub", no_argument, NULL, 'p'},
    {"sub", no_argument, NULL, 's'},
    {"topic", required_argument, NULL, 't'},
    {"domain", required_argument, NULL, 'd'},
    {"count", required_argument, NULL, 'n'},
    {"period-us", required_argument, NULL, 'u'},
    {"reliable", no_argument, NULL, 'r'},
    {"best-effort", no_argument, NULL, 'b'},
    {"durability", required_argument, NULL, 'D'},
    {"history-keep-all", no_argument, NULL, 'K'},
    {"keep-last", required_argument, NULL, 'k'},
    {"size", required_argument, NULL, 'z'},
    {"color", required_argument, NULL, 'c'},
    {"instances", required_argument, NULL, 'i'},
    {"dispose", no_argument, NULL, 'x'},
    {"unregister", no_argument, NULL, 'U'},
    {"xcdr", required_argument, NULL, 'X'},
    {"partition", required_argument, NULL, 'P'},
    {"wait-match", required_argument, NULL, 'w'},
    {"settle", required_argument, NULL, 'S'},
    {"linger", required_argument, NULL, 'l'},
    {"timeout", required_argument, NULL, 'T'},
    {"multicast", required_argument, NULL, 'm'},
    {"peer", required_argument, NULL, 'e'},
    {"interface", required_argument, NULL, 'I'},
    {"deadline-ms", required_argument, NULL, 'L'},
    {"liveliness-ms", required_argument, NULL, 'A'},
    {"strength", required_argument, NULL, 'G'},
    {"filter", required_argument, NULL, 'f'},
    {"filter-parameter", required_argument, NULL, 'F'},
    {"filters", no_argument, NULL, 'y'},
    {NULL, 0, NULL, 0},
};

static void apply(struct peer_options *options, int option, const char *program, const char *value)
{
    switch (option) {
    case 't': options->topic = value; break;
    case 'd': options->domain = (uint32_t)number(program, value); break;
    case 'n': options->count = number(program, value); break;
    case 'u': options->period_us = number(program, value); break;
    case 'r': options->reliable = true; break;
    case 'b': options->reliable = false; break;
    case 'D': options->transient_local = choice(program, value, "transient-local", "volatile"); break;
    case 'K': options->history_depth = 0; break;
    case 'k': options->history_depth = (int32_t)number(program, value); break;
    case 'z': options->size = (uint32_t)number(program, value); break;
    case 'c': options->color = value; break;
    case 'i': options->instances = (uint32_t)number(program, value); break;
    case 'x': options->dispose = true; break;
    case 'U': options->unregister = true; break;
    case 'X': options->xcdr = choice(program, value, "2", "1") ? 2 : 1; break;
    case 'P': options->partition = value; break;
    case 'w': options->wait_match = (int32_t)number(program, value); break;
    case 'S': options->settle_s = seconds(program, value); break;
    case 'l': options->linger_s = seconds(program, value); break;
    case 'T': options->timeout_s = seconds(program, value); break;
    case 'm': options->multicast = choice(program, value, "on", "off"); break;
    case 'e': options->peer = value; break;
    case 'I': options->interface = value; break;
    case 'L': options->deadline_ms = number(program, value); break;
    case 'A': options->liveliness_ms = number(program, value); break;
    case 'G': options->strength = (int32_t)number(program, value); break;
    case 'f': options->filter = value; break;
    case 'F': options->parameter = value; break;
    case 'y': options->filters = true; break;
    default: usage(program);
    }
}

struct peer_options peer_options_parse(int argc, char **argv)
{
    struct peer_options options = {
        .topic = "Square",
        .reliable = true,
        .color = "BLUE",
        .instances = 1,
        .xcdr = 1,
        .wait_match = 1,
        .settle_s = 0.3,
        .timeout_s = 30,
        .multicast = true,
        .strength = -1,
    };
    bool subscriber = false;
    int option;
    while ((option = getopt_long(argc, argv, "", long_options, NULL)) != -1) {
        if (option == 'p')
            options.publisher = true;
        else if (option == 's')
            subscriber = true;
        else
            apply(&options, option, argv[0], optarg);
    }
    /* Room for the instance number behind the color. */
    bool color_fits = strlen(options.color) + 10 <= PEER_COLOR_MAX;
    if (optind != argc || options.publisher == subscriber || options.instances == 0 || !color_fits)
        usage(argv[0]);
    return options;
}

static void on_signal(int signal_number)
{
    (void)signal_number;
    stopped = 1;
}

void peer_catch_signals(void)
{
    struct sigaction action = {.sa_handler = on_signal};
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}

bool peer_stopped(void)
{
    return stopped != 0;
}

double peer_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

void peer_sleep_us(uint64_t microseconds)
{
    struct timespec pause = {
        .tv_sec = (time_t)(microseconds / 1000000),
        .tv_nsec = (long)(microseconds % 1000000) * 1000,
    };
    nanosleep(&pause, NULL);
}

void peer_instance_color(const struct peer_options *options, uint32_t index,
                         char color[PEER_COLOR_MAX + 1])
{
    if (index == 0)
        snprintf(color, PEER_COLOR_MAX + 1, "%s", options->color);
    else
        snprintf(color, PEER_COLOR_MAX + 1, "%s%u", options->color, index);
}

/* Colors come from the wire: whatever JSON does not take literally is escaped. */
static void put_string(const char *text)
{
    putchar('"');
    for (const unsigned char *c = (const unsigned char *)text; *c != '\0'; c++) {
        if (*c < 0x20 || *c >= 0x7f || *c == '"' || *c == '\\')
            printf("\\u%04x", *c);
        else
            putchar(*c);
    }
    putchar('"');
}

static void end_line(void)
{
    putchar('\n');
    fflush(stdout);
    funlockfile(stdout);
}

static void begin_line(const char *event)
{
    flockfile(stdout);
    printf("{\"event\":\"%s\"", event);
}

void peer_print_number(const char *event, const char *field, int64_t value)
{
    begin_line(event);
    printf(",\"%s\":%lld}", field, (long long)value);
    end_line();
}

void peer_print_color(const char *event, const char *color)
{
    begin_line(event);
    printf(",\"color\":");
    put_string(color);
    putchar('}');
    end_line();
}

void peer_print_sample(const char *color, int32_t x, uint32_t size)
{
    begin_line("sample");
    printf(",\"color\":");
    put_string(color);
    printf(",\"x\":%d,\"size\":%u}", (int)x, (unsigned)size);
    end_line();
}

void peer_print_policy(const char *policy)
{
    begin_line("incompatible_qos");
    printf(",\"policy\":");
    put_string(policy);
    putchar('}');
    end_line();
}

const char *peer_policy_name(uint32_t id)
{
    static const char *const names[] = {
        NULL,           "USER_DATA",        "DURABILITY",           "PRESENTATION",
        "DEADLINE",     "LATENCY_BUDGET",   "OWNERSHIP",            "OWNERSHIP_STRENGTH",
        "LIVELINESS",   "TIME_BASED_FILTER", "PARTITION",           "RELIABILITY",
        "DESTINATION_ORDER", "HISTORY",     "RESOURCE_LIMITS",      "ENTITY_FACTORY",
        "WRITER_DATA_LIFECYCLE", "READER_DATA_LIFECYCLE", "TOPIC_DATA", "GROUP_DATA",
        "TRANSPORT_PRIORITY", "LIFESPAN",   "DURABILITY_SERVICE",
    };
    return id < sizeof names / sizeof names[0] ? names[id] : NULL;
}

void peer_print_error(const char *message)
{
    begin_line("error");
    printf(",\"message\":");
    put_string(message);
    putchar('}');
    end_line();
}

void peer_print_done(uint64_t sent, uint64_t received)
{
    begin_line("done");
    printf(",\"sent\":%llu,\"received\":%llu}", (unsigned long long)sent,
           (unsigned long long)received);
    end_line();
}
