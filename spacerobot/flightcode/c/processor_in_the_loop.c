/* Processor in the loop: answers requests of the simulation over a byte stream, standard input and output or a device.
 *
 *     processor_in_the_loop [DEVICE]
 *
 * A frame is 'S', 'R', type, transition, length of the payload (uint16), payload, CRC-16/CCITT of all after "SR" (uint16);
 * integers little-endian, real numbers as IEEE 754 doubles, little-endian.
 *   'H' hello: answered by 64 bytes of signature and a byte with the size of a real number
 *   'I' start: answered by an empty frame
 *   'S' step: inputs; answered by all states, then all commands, then the time of the step [s]
 *   'E' transition: time and inputs; answered by all states
 * A frame that is damaged or unknown is answered by '?'. On a board, replace receive, send and seconds. */
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "processor_table.h"

#define MAX_NUMBERS (STATES + INPUTS + OUTPUTS + 2)

static state_struct state;
static inputs_struct inputs;
static outputs_struct outputs;
static uint8_t payload[8 * MAX_NUMBERS + 72];
static FILE *source, *sink;

static int receive(uint8_t *bytes, size_t size)
{
    return fread(bytes, 1u, size, source) == size;
}

static void send(const uint8_t *bytes, size_t size)
{
    (void)fwrite(bytes, 1u, size, sink);
}

static double seconds(void)
{
    return (double)clock() / (double)CLOCKS_PER_SEC;
}

static uint16_t crc(uint16_t value, const uint8_t *bytes, size_t size)
{
    size_t i;
    int bit;
    for (i = 0u; i < size; ++i) {
        value = (uint16_t)(value ^ (uint16_t)((uint16_t)bytes[i] << 8));
        for (bit = 0; bit < 8; ++bit) {
            value = (uint16_t)((value & 0x8000u) != 0u ? (uint16_t)(value << 1) ^ 0x1021u : (uint16_t)(value << 1));
        }
    }
    return value;
}

static double number_at(const uint8_t *bytes)
{
    uint64_t bits = 0u;
    double value;
    int i;
    for (i = 7; i >= 0; --i) {
        bits = (bits << 8) | bytes[i];
    }
    memcpy(&value, &bits, sizeof value);
    return value;
}

static size_t put(size_t place, double value)
{
    uint64_t bits;
    int i;
    memcpy(&bits, &value, sizeof bits);
    for (i = 0; i < 8; ++i) {
        payload[place + (size_t)i] = (uint8_t)(bits >> (8 * i));
    }
    return place + 8u;
}

static size_t put_all(size_t place, const real *values, size_t size)
{
    size_t i;
    for (i = 0u; i < size; ++i) {
        place = put(place, (double)values[i]);
    }
    return place;
}

static void take_inputs(const uint8_t *bytes)
{
    real *values = (real *)&inputs;
    size_t i;
    for (i = 0u; i < INPUTS; ++i) {
        values[i] = (real)number_at(&bytes[8u * i]);
    }
}

static void answer(uint8_t type, size_t size)
{
    uint8_t head[6] = {'S', 'R', 0u, 0u, 0u, 0u}, tail[2];
    uint16_t check;
    head[2] = type;
    head[4] = (uint8_t)(size & 0xFFu);
    head[5] = (uint8_t)(size >> 8);
    check = crc(crc(0xFFFFu, &head[2], 4u), payload, size);
    tail[0] = (uint8_t)(check & 0xFFu);
    tail[1] = (uint8_t)(check >> 8);
    send(head, sizeof head);
    send(payload, size);
    send(tail, sizeof tail);
    (void)fflush(sink);
}

static void respond(uint8_t type, uint8_t transition, size_t size)
{
    size_t end = 0u;
    if (type == 'H' && size == 0u) {
        memcpy(payload, SIGNATURE, 64u);
        payload[64] = (uint8_t)sizeof(real);
        end = 65u;
    } else if (type == 'I' && size == 0u) {
        INIT(&state);
    } else if (type == 'S' && size == 8u * INPUTS) {
        double begin;
        take_inputs(payload);
        begin = seconds();
        STEP(&state, &inputs, &outputs);
        begin = seconds() - begin;
        end = put_all(end, (const real *)&state, STATES);
        end = put_all(end, (const real *)&outputs, OUTPUTS);
        end = put(end, begin);
    } else if (type == 'E' && size == 8u * (INPUTS + 1u)) {
        take_inputs(&payload[8]);
        if (!enter(transition, &state, &inputs, (real)number_at(payload))) {
            type = '?';
        } else {
            end = put_all(end, (const real *)&state, STATES);
        }
    } else {
        type = '?';
    }
    answer(type, end);
}

int main(int count, char **words)
{
    source = stdin;
    sink = stdout;
    if (count > 1) {
        source = fopen(words[1], "rb");
        sink = fopen(words[1], "wb");
        if (source == NULL || sink == NULL) {
            perror(words[1]);
            return 2;
        }
    }
    (void)setvbuf(source, NULL, _IONBF, 0u);
    INIT(&state);
    for (;;) {
        uint8_t head[4] = {0u, 0u, 0u, 0u}, tail[2], last = 0u, byte = 0u;
        size_t size;
        while (last != (uint8_t)'S' || byte != (uint8_t)'R') {
            last = byte;
            if (!receive(&byte, 1u)) {
                return 0;
            }
        }
        if (!receive(head, sizeof head)) {
            return 0;
        }
        size = (size_t)head[2] | ((size_t)head[3] << 8);
        if (size > sizeof payload) {
            answer('?', 0u);
            continue;
        }
        if (!receive(payload, size) || !receive(tail, sizeof tail)) {
            return 0;
        }
        if (crc(crc(0xFFFFu, head, sizeof head), payload, size) != (uint16_t)(tail[0] | ((uint16_t)tail[1] << 8))) {
            answer('?', 0u);
            continue;
        }
        respond(head[0], head[1], size);
    }
}
