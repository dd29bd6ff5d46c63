/* Prints the results of all frames of a file, bit for bit. After HALF frames a saved state continues in another tracker.
 * boxes KIND CONFIGURATION FILE WIDTH HEIGHT STRIDE FORMAT HALF LEFT TOP WIDTH HEIGHT ... */
#include <foveate.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST 16

static void check(foveate_code code) {
    if (code != FOVEATE_CODE_OK) {
        fprintf(stderr, "code %d: %s\n", (int)code, foveate_last_error());
        exit(EXIT_FAILURE);
    }
}

static void print(int frame, const foveate_result *result) {
    double values[5 + 49];
    memcpy(values, &result->bbox, sizeof result->bbox);
    values[4] = result->p_lost;
    memcpy(values + 5, result->covariance, sizeof result->covariance);
    printf("%d %" PRIu64 " %d %d %" PRId64, frame, result->id, (int)result->status, result->usable, result->detection);
    for (size_t i = 0; i < sizeof values / sizeof *values; i++) {
        uint64_t bits;
        memcpy(&bits, &values[i], sizeof bits);
        printf(" %" PRIx64, bits);
    }
    printf("\n");
}

static void single(const char *configuration, FILE *file, foveate_picture picture, uint8_t *pixels, int half,
                   const foveate_box *boxes) {
    const size_t bytes = picture.stride * (size_t)picture.height;
    foveate_tracker *tracker = NULL;
    check(foveate_tracker_new(configuration, &tracker));
    for (int frame = 0; fread(pixels, 1, bytes, file) == bytes; frame++) {
        if (frame == 0) {
            check(foveate_tracker_init(tracker, &picture, boxes[0]));
            continue;
        }
        foveate_result result;
        check(foveate_tracker_update(tracker, &picture, &result));
        print(frame, &result);
        if (frame == half) {
            size_t size = 0;
            if (foveate_tracker_save(tracker, NULL, 0, &size) != FOVEATE_CODE_BUFFER) exit(EXIT_FAILURE);
            char *state = malloc(size);
            check(foveate_tracker_save(tracker, state, size, &size));
            check(foveate_tracker_free(tracker));
            check(foveate_tracker_new(configuration, &tracker));
            check(foveate_tracker_skip(tracker, &picture));
            check(foveate_tracker_load(tracker, state, size));
            free(state);
        }
    }
    check(foveate_tracker_free(tracker));
}

static void many(const char *configuration, FILE *file, foveate_picture picture, uint8_t *pixels, int half,
                 const foveate_box *boxes, size_t count) {
    const size_t bytes = picture.stride * (size_t)picture.height;
    foveate_multi *tracker = NULL;
    check(foveate_multi_new(configuration, &tracker));
    for (int frame = 0; fread(pixels, 1, bytes, file) == bytes; frame++) {
        size_t targets = 0;
        foveate_detection detections[MOST];
        for (size_t i = 0; i < count; i++) {
            const foveate_detection found = {boxes[i], 0.9};
            detections[i] = found;
            detections[i].bbox.x += frame;
        }
        check(foveate_multi_update(tracker, &picture, detections, frame == 0 ? 0 : count, &targets));
        for (size_t i = 0; frame == 0 && i < count; i++) {
            uint64_t id = 0;
            check(foveate_multi_add(tracker, &picture, boxes[i], &id));
        }
        foveate_result results[MOST];
        check(foveate_multi_targets(tracker, results, MOST, &targets));
        for (size_t i = 0; i < targets; i++) print(frame, &results[i]);
        if (frame == half) {
            size_t size = 0;
            if (foveate_multi_save(tracker, NULL, 0, &size) != FOVEATE_CODE_BUFFER) exit(EXIT_FAILURE);
            char *state = malloc(size);
            check(foveate_multi_save(tracker, state, size, &size));
            check(foveate_multi_free(tracker));
            check(foveate_multi_new(configuration, &tracker));
            check(foveate_multi_load(tracker, state, size));
            check(foveate_multi_skip(tracker, &picture));
            free(state);
        }
    }
    check(foveate_multi_free(tracker));
}

int main(int argc, char **argv) {
    if (argc < 13 || argc > 9 + 4 * MOST) return EXIT_FAILURE;
    FILE *file = fopen(argv[3], "rb");
    if (!file) return EXIT_FAILURE;
    const size_t stride = strtoul(argv[6], NULL, 10), count = (size_t)(argc - 9) / 4;
    const int width = atoi(argv[4]), height = atoi(argv[5]);
    uint8_t *pixels = malloc(stride * (size_t)height);
    const foveate_picture picture = {pixels, width, height, stride, atoi(argv[7])};
    foveate_box boxes[MOST];
    for (size_t i = 0; i < count; i++) {
        const foveate_box box = {atof(argv[9 + 4 * i]), atof(argv[10 + 4 * i]), atof(argv[11 + 4 * i]), atof(argv[12 + 4 * i])};
        boxes[i] = box;
    }
    if (strcmp(argv[1], "single") == 0)
        single(argv[2], file, picture, pixels, atoi(argv[8]), boxes);
    else
        many(argv[2], file, picture, pixels, atoi(argv[8]), boxes, count);
    free(pixels);
    fclose(file);
    return EXIT_SUCCESS;
}
