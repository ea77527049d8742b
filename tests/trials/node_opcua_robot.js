// A server of node-opcua with one robot as the public nodeset of OPC 40010-1 has it: `node tests/trials/wire_peers/node_opcua_robot.js`.
// Axis k stands at 10 k degrees when it begins, and moves 1 degree a second. It prints its port and path when it is
// ready.
"use strict";
const { createServer } = require("net");
const { DataType, OPCUAServer, StatusCodes, nodesets, standardUnits } = require("node-opcua");

const PATH = "/UA/Robot";
const di = "http://opcfoundation.org/UA/DI/";
const robotics = "http://opcfoundation.org/UA/Robotics/";

function freePort() {
  return new Promise((resolve) => {
    const probe = createServer().listen(0, "127.0.0.1", () => {
      const { port } = probe.address();
      probe.close(() => resolve(port));
    });
  });
}

function robotIn(space) {
  const child = (parent, name) => parent.getChildByName(name);
  const typed = (name) => space.findObjectType(name, space.getNamespaceIndex(robotics));
  const deviceSet = space.rootFolder.objects.getFolderElementByName("DeviceSet", space.getNamespaceIndex(di));
  const system = typed("MotionDeviceSystemType").instantiate({ browseName: "Cell", componentOf: deviceSet });
  const robot = typed("MotionDeviceType").instantiate({
    browseName: "Robot",
    componentOf: child(system, "MotionDevices"),
  });
  return [1, 2, 3, 4, 5, 6].map((number) => {
    const axis = typed("AxisType").instantiate({ browseName: `Axis_${number}`, componentOf: child(robot, "Axes") });
    const position = child(child(axis, "ParameterSet"), "ActualPosition");
    const unit = { dataType: DataType.ExtensionObject, value: standardUnits.degree };
    position.getPropertyByName("EngineeringUnits").setValueFromSource(unit);
    return position;
  });
}

async function main() {
  const port = await freePort();
  const server = new OPCUAServer({
    port,
    hostname: "127.0.0.1",
    resourcePath: PATH,
    nodeset_filename: [nodesets.standard, nodesets.di, nodesets.ia, nodesets.robotics],
  });
  await server.initialize();
  const positions = robotIn(server.engine.addressSpace);
  const begin = Date.now();
  const drive = () => {
    const at = new Date();
    positions.forEach((position, k) => {
      const value = 10 * (k + 1) + (at - begin) / 1000;
      position.setValueFromSource({ dataType: DataType.Double, value }, StatusCodes.Good, at);
    });
  };
  drive();
  setInterval(drive, 10);
  await server.start();
  console.log(`ready ${port} ${PATH}`);
}

main().catch((error) => {
  console.error(error.message);
  process.exit(1);
});
