#include "server/http/openapi_files.h"

#include <initializer_list>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace depthtween::server {
namespace {

using FilesJson = nlohmann::ordered_json;

FilesJson ReferenceTo(const std::string& kind, const std::string& name) {
  return {{"$ref", "#/components/" + kind + "/" + name}};
}

FilesJson ListOf(const std::string& kind, std::initializer_list<const char*> names) {
  FilesJson list = FilesJson::array();
  for (const char* name : names) list.push_back(ReferenceTo(kind, name));
  return list;
}

FilesJson HeadersOf(std::initializer_list<const char*> names) {
  FilesJson headers = FilesJson::object();
  for (const char* name : names) headers[name] = ReferenceTo("headers", name);
  return headers;
}

// Content of these media types, as bytes.
FilesJson BytesOf(std::initializer_list<const char*> media_types) {
  FilesJson content = FilesJson::object();
  for (const char* type : media_types) content[type] = FilesJson::object();
  return content;
}

FilesJson FileOperation(const std::string& id, const char* tag, const std::string& description, FilesJson parameters,
                        FilesJson responses) {
  responses["default"] = ReferenceTo("responses", "error");
  return {{"operationId", id},
          {"tags", FilesJson::array({tag})},
          {"description", description},
          {"parameters", std::move(parameters)},
          {"responses", std::move(responses)}};
}

// GET and HEAD of something that is read, with a token or by a signed link.
FilesJson Download(const std::string& id, const std::string& description, FilesJson parameters,
                   std::initializer_list<const char*> media_types) {
  for (const FilesJson& more : ListOf("parameters", {"Range", "If-Range", "If-Match", "If-None-Match"})) {
    parameters.push_back(more);
  }
  FilesJson path;
  for (const bool head : {false, true}) {
    FilesJson whole = {{"description", "All of it"},
                       {"headers", HeadersOf({"ETag", "Accept-Ranges", "Content-Disposition"})}};
    FilesJson part = {{"description", "The bytes that Range asks for"},
                      {"headers", HeadersOf({"ETag", "Content-Range"})}};
    if (!head) whole["content"] = part["content"] = BytesOf(media_types);
    FilesJson operation = FileOperation(id + (head ? "_Head" : ""), "Files", description, parameters,
                                        {{"200", std::move(whole)},
                                         {"206", std::move(part)},
                                         {"304", {{"description", "If-None-Match names what is here"}}},
                                         {"404", ReferenceTo("responses", "error")},
                                         {"412", ReferenceTo("responses", "error")},
                                         {"416", ReferenceTo("responses", "error")}});
    operation["security"] = SecurityOf({"read"}, /*signed_link=*/true);
    path[head ? "head" : "get"] = std::move(operation);
  }
  return path;
}

FilesJson DownloadPaths() {
  return {
      {"/v1/jobs/{job}/outputs/{output}/frames/{frame}.{format}",
       Download("Files_GetFrame", "One frame, as it is stored. It is there as soon as its job has finished it.",
                ListOf("parameters", {"job", "output", "frame", "format"}),
                {"image/png", "image/jpeg", "application/octet-stream"})},
      {"/v1/jobs/{job}/outputs/{output}.zip",
       Download("Files_GetArchive",
                "All frames of an output of a job that has SUCCEEDED, as one zip archive. It is made while it is sent.",
                ListOf("parameters", {"job", "output"}), {"application/zip"})},
      {"/v1/jobs/{job}/outputs/{output}:download",
       Download("Files_GetFile", "An output that is one file.", ListOf("parameters", {"job", "output"}),
                {"application/octet-stream", "application/json", "text/plain", "image/png", "video/mp4"})}};
}

FilesJson TusOperation(const std::string& id, const std::vector<std::string>& scopes, const std::string& description,
                       FilesJson parameters, FilesJson responses) {
  parameters.push_back(ReferenceTo("parameters", "Tus-Resumable"));
  responses["412"] = {{"description", "Tus-Resumable is not 1.0.0"}, {"headers", HeadersOf({"Tus-Version"})}};
  FilesJson operation = FileOperation(id, "Uploads", description, std::move(parameters), std::move(responses));
  operation["security"] = SecurityOf(scopes);
  return operation;
}

FilesJson TusBody(bool required) {
  return {{"required", required}, {"content", BytesOf({"application/offset+octet-stream"})}};
}

FilesJson TusOptionsOperation(const std::string& id, FilesJson parameters) {
  FilesJson operation = FileOperation(
      id, "Uploads", "What of tus the server has.", std::move(parameters),
      {{"204",
        {{"description", "See the headers"},
         {"headers", HeadersOf({"Tus-Resumable", "Tus-Version", "Tus-Extension", "Tus-Checksum-Algorithm"})}}}});
  operation["security"] = FilesJson::array();
  return operation;
}

FilesJson UploadPaths() {
  FilesJson create =
      TusOperation("Uploads_TusCreate", {"write"},
                   "tus 1.0: creates an upload of one file, with its first bytes if there is a body. A file NAME.zip "
                   "that stays alone in "
                   "its sequence is unpacked when the sequence is committed.",
                   ListOf("parameters", {"sequence", "Upload-Length", "Upload-Metadata", "Upload-Checksum"}),
                   {{"201",
                     {{"description", "Created"},
                      {"headers", HeadersOf({"Location", "Upload-Offset", "Upload-Expires", "Tus-Resumable"})}}},
                    {"413", ReferenceTo("responses", "error")},
                    {"460", ReferenceTo("responses", "error")}});
  create["requestBody"] = TusBody(false);

  FilesJson head = TusOperation(
      "Uploads_TusHead", {"read"}, "tus 1.0: how far the upload is. Any upload, also one that StartUpload made.",
      ListOf("parameters", {"sequence", "upload"}),
      {{"200",
        {{"description", "See the headers"},
         {"headers",
          HeadersOf({"Upload-Offset", "Upload-Length", "Upload-Metadata", "Upload-Expires", "Tus-Resumable"})}}}});

  FilesJson patch = TusOperation(
      "Uploads_TusPatch", {"read", "write"},
      "tus 1.0: writes bytes where the upload stands. The last byte finishes it.",
      ListOf("parameters", {"sequence", "upload", "Upload-Offset", "Upload-Checksum"}),
      {{"204",
        {{"description", "Written"}, {"headers", HeadersOf({"Upload-Offset", "Upload-Expires", "Tus-Resumable"})}}},
       {"409", ReferenceTo("responses", "error")},
       {"413", ReferenceTo("responses", "error")},
       {"415", ReferenceTo("responses", "error")},
       {"460", ReferenceTo("responses", "error")}});
  patch["requestBody"] = TusBody(true);

  FilesJson instead = TusOperation("Uploads_TusPost", {"read", "write"},
                                   "PATCH or DELETE, for clients whose surroundings do not let them say so.",
                                   ListOf("parameters", {"sequence", "upload", "X-HTTP-Method-Override"}),
                                   {{"204", {{"description", "As of the method that it stands for"}}}});
  instead["requestBody"] = TusBody(false);

  FilesJson put =
      FileOperation("Uploads_Put", "Uploads",
                    "Writes bytes where the upload stands, all at once or by parts. The last byte finishes it.",
                    ListOf("parameters", {"sequence", "upload", "Content-Range"}),
                    {{"200",
                      {{"description", "Written. What Content-Range: bytes */SIZE asks for: how far it is"},
                       {"headers", HeadersOf({"Upload-Offset"})},
                       {"content", {{"application/json", {{"schema", ReferenceTo("schemas", "Upload")}}}}}}},
                     {"409", ReferenceTo("responses", "error")},
                     {"413", ReferenceTo("responses", "error")}});
  put["security"] = SecurityOf({"read", "write"});
  put["requestBody"] = {{"required", true}, {"content", BytesOf({"application/octet-stream"})}};

  return {
      {"/v1/sequences/{sequence}/uploads:tus",
       {{"post", std::move(create)},
        {"options", TusOptionsOperation("Uploads_TusOptions", ListOf("parameters", {"sequence"}))}}},
      {"/v1/sequences/{sequence}/uploads/{upload}:tus",
       {{"head", std::move(head)},
        {"patch", std::move(patch)},
        {"delete", TusOperation("Uploads_TusDelete", {"write"},
                                "tus 1.0: abandons an upload that is not finished, with its bytes.",
                                ListOf("parameters", {"sequence", "upload"}),
                                {{"204", {{"description", "Gone"}}}, {"409", ReferenceTo("responses", "error")}})},
        {"post", std::move(instead)},
        {"options", TusOptionsOperation("Uploads_TusUploadOptions", ListOf("parameters", {"sequence", "upload"}))}}},
      {"/v1/sequences/{sequence}/uploads/{upload}", {{"put", std::move(put)}}}};
}

FilesJson SharedParameters() {
  FilesJson parameters;
  for (const char* id : {"job", "output", "sequence", "upload"}) {
    parameters[id] = {{"name", id}, {"in", "path"}, {"required", true}, {"schema", {{"type", "string"}}}};
  }
  parameters["frame"] = {{"name", "frame"},
                         {"in", "path"},
                         {"required", true},
                         {"description", "Its number, from 0"},
                         {"schema", {{"type", "integer"}, {"minimum", 0}}}};
  parameters["format"] = {{"name", "format"},
                          {"in", "path"},
                          {"required", true},
                          {"description", "One that the output offers"},
                          {"schema", {{"type", "string"}, {"enum", {"png", "jpg", "npz", "flo", "pfm"}}}}};
  const auto header = [&parameters](const char* name, const char* description, bool required = false) {
    parameters[name] = {{"name", name},
                        {"in", "header"},
                        {"required", required},
                        {"description", description},
                        {"schema", {{"type", "string"}}}};
  };
  header("Range", "bytes=FIRST-LAST; several ranges are answered whole");
  header("If-Range", "An ETag: Range counts only while it is the present one");
  header("If-Match", "ETags: 412 unless one is the present one");
  header("If-None-Match", "ETags: 304 if one is the present one");
  header("Tus-Resumable", "1.0.0", true);
  header("Upload-Length", "Bytes of the file", true);
  header(
      "Upload-Metadata",
      "Pairs KEY BASE64, with commas: path (or filename), its place in the recording; if wished sha256 and request_id. "
      "All of them are kept and come back with HEAD",
      true);
  header("Upload-Offset", "Where the body begins: where the upload stands", true);
  header("Upload-Checksum", "sha1 BASE64 or sha256 BASE64, of the body: nothing of it is kept if it does not match");
  header("X-HTTP-Method-Override", "PATCH or DELETE", true);
  header("Content-Range", "bytes FIRST-LAST/SIZE, or bytes */SIZE with no body to ask how far the upload is");
  return parameters;
}

FilesJson SharedHeaders() {
  FilesJson headers;
  const auto header = [&headers](const char* name, const char* description) {
    headers[name] = {{"description", description}, {"schema", {{"type", "string"}}}};
  };
  header("ETag", "Strong: it names these bytes");
  header("Accept-Ranges", "bytes");
  header("Content-Disposition", "A name for the file");
  header("Content-Range", "Which bytes of how many");
  header("Location", "The upload: the path for HEAD, PATCH and DELETE");
  header("Upload-Offset", "How many bytes are safe, and where to go on");
  header("Upload-Length", "Bytes of the upload");
  header("Upload-Metadata", "As it was created with");
  header("Upload-Expires", "Until when an unfinished upload is kept if no more bytes come");
  header("Tus-Resumable", "1.0.0");
  header("Tus-Version", "1.0.0");
  header("Tus-Extension", "Which there are");
  header("Tus-Checksum-Algorithm", "Which there are");
  return headers;
}

}  // namespace

FilesJson SecurityOf(const std::vector<std::string>& scopes, bool signed_link) {
  FilesJson ways = FilesJson::array({FilesJson{{"bearer", scopes}}});
  if (signed_link) ways.push_back({{"signature", FilesJson::array()}});
  return ways;
}

FilesJson FileRoutesOfOpenApi() {
  FilesJson paths = DownloadPaths();
  paths.update(UploadPaths());
  return {{"paths", std::move(paths)},
          {"components",
           {{"parameters", SharedParameters()},
            {"headers", SharedHeaders()},
            {"responses",
             {{"error",
               {{"description", "What went wrong"},
                {"content", {{"application/json", {{"schema", ReferenceTo("schemas", "google.rpc.Status")}}}}}}}}}}}};
}

}  // namespace depthtween::server
