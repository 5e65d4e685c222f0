/* The worst calls that a search has found, and their instructions on an emulated Cortex-M: `make worst`.
 *
 * An instruction takes 64 ns of the emulator's time, and the board's timer ticks every 40 ns. */
#include <stdint.h>
#include <stdio.h>

#include "{{ name }}.h"

/* Control, value and reload of timer 0, which counts down. */
static volatile uint32_t *const timer = (volatile uint32_t *)0x40000000u;

static const struct {
    int fault;
    ca_real wrench[CA_M];
    const char *most;
} worst[] = {
{% for most, call in worst.calls.items() %}
    {{ '{' }}{{ call.fault }}, {{ call.wrench | literal }}, "{{ most }}"},
{% endfor %}
};

int main(void)
{
    timer[2] = timer[1] = 0xFFFFFFFFu;
    timer[0] = 1;
    for (int i = 0; i < (int)(sizeof worst / sizeof *worst); i++) {
        ca_real speeds[CA_N];
        const uint32_t before = timer[1];
        const int status = {{ name }}_allocate(worst[i].fault, worst[i].wrench, speeds);
        const uint32_t ticks = before - timer[1];
        printf("most %s: fault %d, status %d, %lu instructions\n", worst[i].most, worst[i].fault,
               status, (unsigned long)((uint64_t)ticks * 40 / 64));
    }
    return 0;
}
