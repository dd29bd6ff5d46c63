// foveate: follow one target or many through video. Made by cbindgen from the crate foveate-c; docs/c.md is the guide.
//
// A pointer is null, or the address of as many values as the comment of the function or field states; they do not change during the
// call. A text ends with a 0. Null where a value is needed gives FOVEATE_CODE_INVALID.

#ifndef FOVEATE_H
#define FOVEATE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// The result of a function. After any code but FOVEATE_CODE_OK, foveate_last_error() has the text.
enum foveate_code
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // The call succeeded.
  FOVEATE_CODE_OK = 0,
  // An argument is null, not finite, out of range or of the wrong size. The tracker has not changed, except by a failed load.
  FOVEATE_CODE_INVALID = 1,
  // The handle is null, was freed, or belongs to the other kind of tracker.
  FOVEATE_CODE_HANDLE = 2,
  // No configuration has this name, or a setting is misspelled or out of range.
  FOVEATE_CODE_CONFIG = 3,
  // A model file of the configuration cannot be read.
  FOVEATE_CODE_FILE = 4,
  // The picture or the targets exceed the memory limit.
  FOVEATE_CODE_MEMORY = 5,
  // The buffer is too small. The required size was written.
  FOVEATE_CODE_BUFFER = 6,
  // A fault inside foveate. Free the tracker.
  FOVEATE_CODE_INTERNAL = 7,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum foveate_code foveate_code;
#else
typedef int32_t foveate_code;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// The tracker's report on a target.
enum foveate_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // The box is on the target.
  FOVEATE_STATUS_TRACKING = 0,
  // The target is probably lost, for a few frames. The box is a guess.
  FOVEATE_STATUS_OCCLUDED = 1,
  // The target is probably lost. The box is a guess.
  FOVEATE_STATUS_LOST = 2,
  // The box is on the target again after a loss.
  FOVEATE_STATUS_REACQUIRED = 3,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum foveate_status foveate_status;
#else
typedef int32_t foveate_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// The order of the bytes of a pixel.
enum foveate_format
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
  // One grey byte.
  FOVEATE_FORMAT_GREY = 0,
  // Red, green, blue.
  FOVEATE_FORMAT_RGB = 1,
  // Blue, green, red, as in OpenCV.
  FOVEATE_FORMAT_BGR = 2,
  // Red, green, blue, and a byte that is not read.
  FOVEATE_FORMAT_RGBA = 3,
  // Blue, green, red, and a byte that is not read.
  FOVEATE_FORMAT_BGRA = 4,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum foveate_format foveate_format;
#else
typedef int32_t foveate_format;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

// Follows many targets.
typedef struct foveate_multi foveate_multi;

// Follows one target.
typedef struct foveate_tracker foveate_tracker;

// A picture in the caller's memory. It is read during the call only.
typedef struct foveate_picture {
  // The first byte of the top row. `stride * (height - 1)` bytes and one row must be readable.
  const uint8_t *pixels;
  // Width in pixels.
  int32_t width;
  // Height in pixels.
  int32_t height;
  // Bytes from a row to the next, at least those of a row.
  size_t stride;
  // A foveate_format.
  int32_t format;
} foveate_picture;

// An upright box, pixels from 0.
typedef struct foveate_box {
  // Left edge.
  double x;
  // Top edge.
  double y;
  // Width.
  double width;
  // Height.
  double height;
} foveate_box;

// One target in one frame.
typedef struct foveate_result {
  // The number of the target, from 1.
  uint64_t id;
  // The estimated box.
  struct foveate_box bbox;
  // The probability, 0 to 1, that the box has an IoU below 0.1 with the target or that the target is not visible.
  double p_lost;
  // Covariance of x, y, their velocities per frame (pixels), log scale, angle (radians) and log aspect.
  double covariance[7][7];
  // The index of the detection that was assigned to the target in this frame; -1 if there is none.
  int64_t detection;
  // The status.
  foveate_status status;
  // Whether the status is tracking or reacquired. Otherwise the box is a guess.
  bool usable;
} foveate_result;

// A box found by the caller's detector.
typedef struct foveate_detection {
  // The box.
  struct foveate_box bbox;
  // The score; a larger one is surer. NaN if there is none.
  double score;
} foveate_detection;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Returns the version of the library.
const char *foveate_version(void);

// Returns the text of the last call that failed in this thread: the place, the expectation, the finding and the remedy, in UTF-8.
// The text is valid until the next failed call of the thread.
const char *foveate_last_error(void);

// Creates a tracker of one target. `configuration` is the name of a profile ("fast", "balanced", "accurate") or of a shipped
// configuration, or the text of a TOML file, which has more than one line. Model files in it are relative to the current folder.
foveate_code foveate_tracker_new(const char *configuration,
                                 struct foveate_tracker **tracker);

// Frees a tracker; the handle is invalid afterwards. Null is allowed.
foveate_code foveate_tracker_free(struct foveate_tracker *tracker);

// Starts or restarts on the target in this box of a picture.
foveate_code foveate_tracker_init(struct foveate_tracker *tracker,
                                  const struct foveate_picture *picture,
                                  struct foveate_box bbox);

// Tracks the target in the next picture, which has the size of the first one.
foveate_code foveate_tracker_update(struct foveate_tracker *tracker,
                                    const struct foveate_picture *picture,
                                    struct foveate_result *result);

// Sets the time of the next picture, seconds from any origin. If frames were dropped before it, the particles move for as many frames
// more, 30 at most; at a constant rate nothing changes.
foveate_code foveate_tracker_set_time(struct foveate_tracker *tracker,
                                      double seconds);

// Predicts the target `frames` frames after the last picture, 0 to 1000000 and with fractions, from its motion: to aim a camera or an arm.
// Status and P(lost) are those of the last picture. The tracker does not change. It fails before the first picture and after a load.
foveate_code foveate_tracker_predict(const struct foveate_tracker *tracker,
                                     double frames,
                                     struct foveate_result *result);

// Predicts as foveate_tracker_predict, for a time on the clock of foveate_tracker_set_time.
foveate_code foveate_tracker_predict_at(const struct foveate_tracker *tracker,
                                        double seconds,
                                        struct foveate_result *result);

// Moves the target into this box: draws particles around it, and sets P(lost) to 0 until the next picture. The template and what was
// learned do not change.
foveate_code foveate_tracker_reset_at(struct foveate_tracker *tracker,
                                      struct foveate_box bbox);

// Observes a picture without tracking: one before the first, or the last one before foveate_tracker_load.
foveate_code foveate_tracker_skip(struct foveate_tracker *tracker, const struct foveate_picture *picture);

// Writes the state as JSON, without a final 0, to a buffer of `capacity` bytes, and its size in bytes to `size`. If the buffer is too
// small, nothing but the size is written, and the code is FOVEATE_CODE_BUFFER: call with a capacity of 0 to get the size.
foveate_code foveate_tracker_save(const struct foveate_tracker *tracker,
                                  char *buffer,
                                  size_t capacity,
                                  size_t *size);

// Restores a state of `size` bytes in a tracker of the same configuration. To continue bit for bit, call foveate_tracker_skip with the
// last picture before. After an error, call foveate_tracker_init.
foveate_code foveate_tracker_load(struct foveate_tracker *tracker,
                                  const char *state,
                                  size_t size);

// Creates a tracker of many targets, as foveate_tracker_new. Configurations for it are "multi" and "multi-boxes", for example.
foveate_code foveate_multi_new(const char *configuration,
                               struct foveate_multi **tracker);

// Frees a tracker; the handle is invalid afterwards. Null is allowed.
foveate_code foveate_multi_free(struct foveate_multi *tracker);

// Tracks all targets in the next picture. `detections` are `count` boxes of your detector; null if there are none. Writes the number of
// active targets to `targets`; foveate_multi_targets returns them.
foveate_code foveate_multi_update(struct foveate_multi *tracker,
                                  const struct foveate_picture *picture,
                                  const struct foveate_detection *detections,
                                  size_t count,
                                  size_t *targets);

// Writes the active targets of the last picture, by id, to `results`, which has space for `capacity` of them, and their number to
// `count`. If there are more, the code is FOVEATE_CODE_BUFFER, and only the number is written.
foveate_code foveate_multi_targets(const struct foveate_multi *tracker,
                                   struct foveate_result *results,
                                   size_t capacity,
                                   size_t *count);

// Adds a target with its box in the picture of the last update, or restarts one. `id` is the number of the target, or 0 for the next
// free one, which is then written to it.
foveate_code foveate_multi_add(struct foveate_multi *tracker,
                               const struct foveate_picture *picture,
                               struct foveate_box bbox,
                               uint64_t *id);

// Ends the track of the target with this number permanently.
foveate_code foveate_multi_remove(struct foveate_multi *tracker, uint64_t id);

// Observes a picture without tracking: one before the first update, or before the first update after foveate_multi_load.
foveate_code foveate_multi_skip(struct foveate_multi *tracker,
                                const struct foveate_picture *picture);

// Writes the state, as foveate_tracker_save.
foveate_code foveate_multi_save(const struct foveate_multi *tracker, char *buffer, size_t capacity, size_t *size);

// Restores a state of `size` bytes in a tracker of the same configuration; after an error nothing has changed. To continue bit for bit,
// call foveate_multi_skip with the last picture afterwards.
foveate_code foveate_multi_load(struct foveate_multi *tracker,
                                const char *state,
                                size_t size);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* FOVEATE_H */
