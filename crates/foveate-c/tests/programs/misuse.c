/* Misuse gives codes and texts, and leaves a good tracker good. */
#include <foveate.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int failed = 0;

static void expect(int line, foveate_code code, foveate_code expected, const char *word) {
    const char *text = code == FOVEATE_CODE_OK ? "" : foveate_last_error();
    if (code != expected || !strstr(text, word)) {
        fprintf(stderr, "misuse.c:%d: code %d, expected %d with \"%s\": %s\n", line, (int)code, (int)expected, word, text);
        failed = 1;
    }
}
#define FAILS(code, call, word) expect(__LINE__, call, FOVEATE_CODE_##code, word)
#define WORKS(call) expect(__LINE__, call, FOVEATE_CODE_OK, "")

static uint8_t pixels[120 * 90 * 3];
static char state[1 << 22];

int main(void) {
    for (size_t i = 0; i < sizeof pixels; i++) pixels[i] = (uint8_t)(i * i / 7);
    const foveate_picture good = {pixels, 120, 90, 360, FOVEATE_FORMAT_RGB};
    const foveate_box box = {40, 30, 24, 20};
    const double nan = (double)NAN;
    foveate_tracker *tracker = NULL, *other = NULL;
    foveate_multi *multi = NULL;
    foveate_result result;
    size_t size = 0;
    uint64_t id = 0;

    FAILS(INVALID, foveate_tracker_new(NULL, &tracker), "configuration");
    FAILS(INVALID, foveate_tracker_new("fast", NULL), "tracker");
    FAILS(CONFIG, foveate_tracker_new("no-such-name", &tracker), "no-such-name");
    FAILS(CONFIG, foveate_tracker_new("particles = 100\nno_such_key = 1\n", &tracker), "no_such_key");
    FAILS(INVALID, foveate_tracker_new("\xff\xfe", &tracker), "UTF-8");
    if (tracker) return EXIT_FAILURE;
    WORKS(foveate_tracker_free(NULL));
    WORKS(foveate_multi_free(NULL));
    WORKS(foveate_tracker_new("fast", &tracker));
    WORKS(foveate_tracker_new("natural", &other));
    WORKS(foveate_multi_new("multi", &multi));

    FAILS(HANDLE, foveate_tracker_init(NULL, &good, box), "null");
    FAILS(HANDLE, foveate_tracker_init((foveate_tracker *)multi, &good, box), "other kind");
    FAILS(HANDLE, foveate_tracker_init((foveate_tracker *)(void *)pixels, &good, box), "no such tracker");
    FAILS(INVALID, foveate_tracker_update(tracker, &good, &result), "init");
    FAILS(INVALID, foveate_tracker_init(tracker, NULL, box), "picture");

    foveate_picture bad[8];
    const char *words[8] = {"pixels", "0 x 90", "120 x -1", "stride", "format", "format", "stride", "memory"};
    for (int i = 0; i < 8; i++) bad[i] = good;
    bad[0].pixels = NULL;
    bad[1].width = 0;
    bad[2].height = -1;
    bad[3].stride = 359;
    bad[4].format = 5;
    bad[5].format = -1;
    bad[6].stride = (size_t)-1;
    bad[7].width = bad[7].height = INT32_MAX / 4;
    bad[7].stride = (size_t)INT32_MAX;
    for (int i = 0; i < 8; i++) {
        const foveate_code code = i == 7 ? FOVEATE_CODE_MEMORY : FOVEATE_CODE_INVALID;
        expect(__LINE__, foveate_tracker_init(tracker, &bad[i], box), code, words[i]);
        expect(__LINE__, foveate_tracker_skip(tracker, &bad[i]), code, words[i]);
        expect(__LINE__, foveate_multi_update(multi, &bad[i], NULL, 0, &size), code, words[i]);
    }
    for (int i = 0; i < 4; i++) {
        const double values[3] = {nan, (double)INFINITY, 1e300};
        for (int k = 0; k < 3; k++) {
            double edges[4] = {40, 30, 24, 20};
            edges[i] = values[k];
            foveate_box wrong;
            memcpy(&wrong, edges, sizeof wrong);
            if (k < 2 || i < 2) FAILS(INVALID, foveate_tracker_init(tracker, &good, wrong), "");
            if (k < 2 || i < 2) FAILS(INVALID, foveate_multi_add(multi, &good, wrong, &id), "");
        }
    }
    /* One row: the stride leads nowhere. */
    foveate_picture row = good;
    row.height = 1;
    row.stride = (size_t)-1;
    WORKS(foveate_tracker_skip(other, &row));
    const foveate_box outside = {500, 500, 20, 20}, empty = {40, 30, 0, 20};
    FAILS(INVALID, foveate_tracker_init(tracker, &good, outside), "");
    FAILS(INVALID, foveate_tracker_init(tracker, &good, empty), "");

    WORKS(foveate_tracker_init(tracker, &good, box));
    FAILS(INVALID, foveate_tracker_update(tracker, &good, NULL), "result");
    foveate_picture smaller = good, grey = good;
    smaller.height = 80;
    grey.format = FOVEATE_FORMAT_GREY;
    FAILS(INVALID, foveate_tracker_update(tracker, &smaller, &result), "120 x 90");
    FAILS(INVALID, foveate_tracker_update(tracker, &grey, &result), "planes");
    WORKS(foveate_tracker_update(tracker, &good, &result));

    FAILS(BUFFER, foveate_tracker_save(tracker, state, 10, &size), "larger");
    FAILS(INVALID, foveate_tracker_save(tracker, NULL, 10, &size), "buffer");
    FAILS(INVALID, foveate_tracker_save(tracker, state, sizeof state, NULL), "size");
    WORKS(foveate_tracker_save(tracker, state, sizeof state, &size));
    FAILS(INVALID, foveate_tracker_load(other, state, size), "");
    FAILS(INVALID, foveate_tracker_load(tracker, state, size / 2), "JSON");
    FAILS(INVALID, foveate_tracker_load(tracker, "{}", 2), "");
    FAILS(INVALID, foveate_tracker_load(tracker, NULL, 2), "state");
    FAILS(INVALID, foveate_tracker_load(tracker, state, (size_t)-1), "state");
    FAILS(INVALID, foveate_tracker_save(tracker, state, (size_t)-1, &size), "buffer");
    WORKS(foveate_tracker_load(tracker, state, size));
    WORKS(foveate_tracker_update(tracker, &good, &result));

    const foveate_detection wrong = {{40, nan, 24, 20}, 0.5};
    FAILS(INVALID, foveate_multi_update(multi, &good, &wrong, 1, &size), "top");
    FAILS(INVALID, foveate_multi_update(multi, &good, NULL, 1, &size), "detections");
    FAILS(INVALID, foveate_multi_update(multi, &good, &wrong, (size_t)-1, &size), "detections");
    FAILS(INVALID, foveate_multi_update(multi, &good, NULL, 0, NULL), "targets");
    WORKS(foveate_multi_update(multi, &good, NULL, 0, &size));
    FAILS(INVALID, foveate_multi_add(multi, &good, box, NULL), "id");
    WORKS(foveate_multi_add(multi, &good, box, &id));
    FAILS(BUFFER, foveate_multi_targets(multi, NULL, 0, &size), "1 targets");
    FAILS(INVALID, foveate_multi_targets(multi, NULL, 1, &size), "results");
    FAILS(INVALID, foveate_multi_targets(multi, &result, (size_t)-1, &size), "results");
    WORKS(foveate_multi_targets(multi, &result, 1, &size));
    if (size != 1 || result.id != id) failed = 1;
    FAILS(INVALID, foveate_multi_remove(multi, id + 1), "no target");
    WORKS(foveate_multi_remove(multi, id));
    FAILS(INVALID, foveate_multi_load(multi, "[]", 2), "");

    WORKS(foveate_tracker_free(tracker));
    FAILS(HANDLE, foveate_tracker_free(tracker), "freed");
    FAILS(HANDLE, foveate_tracker_update(tracker, &good, &result), "freed");
    FAILS(HANDLE, foveate_tracker_save(tracker, state, sizeof state, &size), "freed");
    FAILS(HANDLE, foveate_multi_free((foveate_multi *)other), "other kind");
    WORKS(foveate_tracker_free(other));
    WORKS(foveate_multi_free(multi));
    FAILS(HANDLE, foveate_multi_targets(multi, &result, 1, &size), "freed");
    if (strlen(foveate_version()) < 5) failed = 1;
    return failed;
}
