/* What the peer programs of all vendors share: the command line and the events they print. */
#ifndef PEER_H
#define PEER_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PEER_COLOR_MAX 128 /* bound of ShapeType.color, terminating NUL not counted */

struct peer_options {
    bool publisher;
    const char *topic;
    uint32_t domain;
    uint64_t count;      /* samples to write or to receive; 0: until stopped */
    uint64_t period_us;  /* between two samples of a publisher */
    bool reliable;
    bool transient_local;
    int32_t history_depth; /* 0: KEEP_ALL */
    uint32_t size;         /* octets in additional_payload_size */
    const char *color;
    uint32_t instances;
    bool dispose;
    bool unregister;
    int xcdr; /* 1 or 2 */
    const char *partition; /* NULL: the default partition */
    int32_t wait_match;    /* matched readers that a publisher waits for */
    double settle_s;       /* a publisher's pause between matching and its first sample */
    double linger_s;       /* stays this long after its count is reached */
    double timeout_s;      /* gives up after this long */
    bool multicast;
    const char *peer;      /* address to announce to, NULL: none */
    const char *interface; /* name (Cyclone) or address (Fast DDS), NULL: the vendor's choice */
    uint64_t deadline_ms;  /* 0: no deadline */
    uint64_t liveliness_ms; /* lease of AUTOMATIC liveliness, 0: infinite */
    int32_t strength;      /* of EXCLUSIVE ownership, -1: SHARED */
    const char *filter;     /* a subscriber's filter expression, NULL: none (Fast DDS only) */
    const char *parameter;  /* its %0, NULL: none */
    bool filters;           /* a publisher filters as readers want (Fast DDS only) */
};

/* Reads the command line; prints the usage and exits with 2 when it cannot. */
struct peer_options peer_options_parse(int argc, char **argv);

/* Turns SIGINT and SIGTERM into peer_stopped(). */
void peer_catch_signals(void);
bool peer_stopped(void);

/* Seconds of the monotonic clock. */
double peer_now(void);
void peer_sleep_us(uint64_t microseconds);

/* Writes the color of instance `index` into `color`: the plain color, then color1, color2... */
void peer_instance_color(const struct peer_options *options, uint32_t index,
                         char color[PEER_COLOR_MAX + 1]);

/* One JSON object a line on standard output, flushed; callable from any thread. */
void peer_print_number(const char *event, const char *field, int64_t value);
void peer_print_color(const char *event, const char *color);
void peer_print_sample(const char *color, int32_t x, uint32_t size);
void peer_print_policy(const char *policy);

/* Name of a QoS policy by its number in DDS 1.4 (2.3.3), NULL above those; vendors number what
 * XTypes added each in their own way. */
const char *peer_policy_name(uint32_t id);

void peer_print_error(const char *message);
void peer_print_done(uint64_t sent, uint64_t received);

#ifdef __cplusplus
}
#endif

#endif
