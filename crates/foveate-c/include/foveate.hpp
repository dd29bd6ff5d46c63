// foveate for C++17: classes over foveate.h that free themselves. Failures are exceptions of type foveate::Error. Include OpenCV's core
// header first, and pictures may be cv::Mat: one channel is grey, three are BGR, four are BGRA. docs/c.md is the guide.

#ifndef FOVEATE_HPP
#define FOVEATE_HPP

#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "foveate.h"

namespace foveate {

using Box = foveate_box;
using Detection = foveate_detection;
using Picture = foveate_picture;
using Result = foveate_result;

// A failed call: its code, and the text that foveate_last_error() had.
class Error : public std::runtime_error {
public:
    Error(foveate_code code, const char *text) : std::runtime_error(text), code_(code) {}
    foveate_code code() const noexcept { return code_; }

private:
    foveate_code code_;
};

namespace detail {

inline void check(foveate_code code) {
    if (code != FOVEATE_CODE_OK) throw Error(code, foveate_last_error());
}

struct Free {
    void operator()(foveate_tracker *tracker) const noexcept { foveate_tracker_free(tracker); }
    void operator()(foveate_multi *tracker) const noexcept { foveate_multi_free(tracker); }
};

// Calls a function that writes to a buffer until the buffer is large enough.
template <typename T, typename Write> T filled(T buffer, Write write) {
    std::size_t size = 0;
    foveate_code code = FOVEATE_CODE_OK;
    while ((code = write(buffer.data(), buffer.size(), &size)) == FOVEATE_CODE_BUFFER) buffer.resize(size);
    check(code);
    buffer.resize(size);
    return buffer;
}

} // namespace detail

#ifdef OPENCV_CORE_MAT_HPP
// Views a matrix of bytes as a picture, without a copy.
inline Picture picture(const cv::Mat &image) {
    const int channels = image.channels();
    if (image.depth() != CV_8U || image.dims != 2 || (channels != 1 && channels != 3 && channels != 4)) {
        throw Error(FOVEATE_CODE_INVALID, "the picture must be a cv::Mat of type CV_8UC1, CV_8UC3 (BGR) or CV_8UC4 (BGRA)");
    }
    const foveate_format format =
        channels == 1 ? FOVEATE_FORMAT_GREY : channels == 3 ? FOVEATE_FORMAT_BGR : FOVEATE_FORMAT_BGRA;
    return {image.data, image.cols, image.rows, image.step[0], format};
}

inline Box box(const cv::Rect2d &rect) { return {rect.x, rect.y, rect.width, rect.height}; }
inline cv::Rect2d rect(const Box &box) { return {box.x, box.y, box.width, box.height}; }
#endif

// Follows one target. `configuration` is a name or TOML text, as for foveate_tracker_new.
class Tracker {
public:
    explicit Tracker(const std::string &configuration = "balanced") {
        foveate_tracker *handle = nullptr;
        detail::check(foveate_tracker_new(configuration.c_str(), &handle));
        handle_.reset(handle);
    }
    void init(const Picture &picture, const Box &box) {
        detail::check(foveate_tracker_init(handle_.get(), &picture, box));
    }
    Result update(const Picture &picture) {
        Result result{};
        detail::check(foveate_tracker_update(handle_.get(), &picture, &result));
        return result;
    }
    void set_time(double seconds) { detail::check(foveate_tracker_set_time(handle_.get(), seconds)); }
    Result predict(double frames) const {
        Result result{};
        detail::check(foveate_tracker_predict(handle_.get(), frames, &result));
        return result;
    }
    Result predict_at(double seconds) const {
        Result result{};
        detail::check(foveate_tracker_predict_at(handle_.get(), seconds, &result));
        return result;
    }
    void reset_at(const Box &box) { detail::check(foveate_tracker_reset_at(handle_.get(), box)); }
    void skip(const Picture &picture) { detail::check(foveate_tracker_skip(handle_.get(), &picture)); }
    std::string save() const {
        return detail::filled(std::string(), [this](char *buffer, std::size_t capacity, std::size_t *size) {
            return foveate_tracker_save(handle_.get(), buffer, capacity, size);
        });
    }
    void load(std::string_view state) {
        detail::check(foveate_tracker_load(handle_.get(), state.data(), state.size()));
    }
#ifdef OPENCV_CORE_MAT_HPP
    void init(const cv::Mat &image, const cv::Rect2d &rect) { init(picture(image), box(rect)); }
    Result update(const cv::Mat &image) { return update(picture(image)); }
    void skip(const cv::Mat &image) { skip(picture(image)); }
#endif

private:
    std::unique_ptr<foveate_tracker, detail::Free> handle_;
};

// Follows many targets.
class MultiTracker {
public:
    explicit MultiTracker(const std::string &configuration = "multi") {
        foveate_multi *handle = nullptr;
        detail::check(foveate_multi_new(configuration.c_str(), &handle));
        handle_.reset(handle);
    }
    // Tracks all targets in the next picture. Returns the active ones, by id; the boxes of those that are not usable are guesses.
    std::vector<Result> update(const Picture &picture, const std::vector<Detection> &detections = {}) {
        std::size_t count = 0;
        detail::check(
            foveate_multi_update(handle_.get(), &picture, detections.data(), detections.size(), &count));
        return targets();
    }
    std::vector<Result> targets() const {
        return detail::filled(std::vector<Result>(), [this](Result *results, std::size_t capacity, std::size_t *count) {
            return foveate_multi_targets(handle_.get(), results, capacity, count);
        });
    }
    // Adds a target, or restarts the one with this number. Returns its number.
    std::uint64_t add(const Picture &picture, const Box &box, std::uint64_t id = 0) {
        detail::check(foveate_multi_add(handle_.get(), &picture, box, &id));
        return id;
    }
    void remove(std::uint64_t id) { detail::check(foveate_multi_remove(handle_.get(), id)); }
    void skip(const Picture &picture) { detail::check(foveate_multi_skip(handle_.get(), &picture)); }
    std::string save() const {
        return detail::filled(std::string(), [this](char *buffer, std::size_t capacity, std::size_t *size) {
            return foveate_multi_save(handle_.get(), buffer, capacity, size);
        });
    }
    void load(std::string_view state) {
        detail::check(foveate_multi_load(handle_.get(), state.data(), state.size()));
    }
#ifdef OPENCV_CORE_MAT_HPP
    std::vector<Result> update(const cv::Mat &image, const std::vector<Detection> &detections = {}) {
        return update(picture(image), detections);
    }
    std::uint64_t add(const cv::Mat &image, const cv::Rect2d &rect, std::uint64_t id = 0) {
        return add(picture(image), box(rect), id);
    }
    void skip(const cv::Mat &image) { skip(picture(image)); }
#endif

private:
    std::unique_ptr<foveate_multi, detail::Free> handle_;
};

#ifdef OPENCV_CORE_MAT_HPP
// Has the functions of cv::Tracker. The box is in whole pixels inside the picture. If the target is occluded or lost, `update` returns
// false and leaves the box as it is.
class CvTracker {
public:
    explicit CvTracker(const std::string &configuration = "balanced") : tracker_(configuration) {}
    void init(cv::InputArray image, const cv::Rect &box) { tracker_.init(image.getMat(), cv::Rect2d(box)); }
    bool update(cv::InputArray image, cv::Rect &box) {
        result_ = tracker_.update(image.getMat());
        if (result_.usable) {
            const Box &b = result_.bbox;
            const cv::Size size = image.size();
            const int left = whole(b.x, 0, size.width - 1), top = whole(b.y, 0, size.height - 1);
            box = {left, top, whole(b.x + b.width, left + 1, size.width) - left,
                   whole(b.y + b.height, top + 1, size.height) - top};
        }
        return result_.usable;
    }
    // The last result, with P(lost) and the covariance.
    const Result &result() const { return result_; }

private:
    static int whole(double edge, int least, int most) {
        return cvRound(edge < least ? least : edge > most ? most : edge);
    }
    Tracker tracker_;
    Result result_{};
};
#endif

} // namespace foveate

#endif
