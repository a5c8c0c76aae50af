-- Jobs that compute the scene flow of a recording instead of upsampling it.

ALTER TABLE jobs ADD COLUMN scene_flow_options TEXT;  -- JSON of SceneFlowOptions; none: an upsampling
