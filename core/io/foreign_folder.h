// A folder that holds a recording, but not in the layout that is read here: what it is, and how to make it readable.
#ifndef DEPTHTWEEN_CORE_IO_FOREIGN_FOLDER_H_
#define DEPTHTWEEN_CORE_IO_FOREIGN_FOLDER_H_

#include <optional>
#include <string>

namespace depthtween {

// What is found in `dir` beside the lists and the camera, for people: the layout of 7-Scenes (frame-000000.color.png),
// folders of images (rgb/ depth/, color/ depth/ as Open3D writes them), videos and recordings in one file; and the
// commands that make the missing lists. None when nothing is recognised. Looks at names alone, at most a few thousand.
std::optional<std::string> DescribeForeignFolder(const std::string& dir);

}  // namespace depthtween

#endif  // DEPTHTWEEN_CORE_IO_FOREIGN_FOLDER_H_
