export {
  BufferAttribute, BufferGeometry, Color, DataTexture, DoubleSide, LinearFilter, LinearSRGBColorSpace, LineSegments, Mesh,
  OrthographicCamera, Points, RGBAFormat, Scene, ShaderMaterial, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
