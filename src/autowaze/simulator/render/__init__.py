"""Drawing a scene with OpenGL on EGL, no screen needed."""
